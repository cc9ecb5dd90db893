"""FusionNet: a sentence and a picture move a block.

    from fusionnet import load_policy, make_world

    policy = load_policy("compact")
    world = make_world(robot="nico", seed=24)
    answer = policy(world.image("left_eye"), "put the red pyramid on the blue cube")
    episode = world.execute(answer)

The rooms below are imported only when one of their names is asked for. `import fusionnet`
registers `fusionnet/PickPlace-v0` and `fusionnet/PickPlaceServo-v0` with Gymnasium, and costs no
more than importing that.
"""

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from fusionnet.policy import Answer, load_policy
    from fusionnet.simulation import make_world

__all__ = ["Answer", "load_policy", "make_world"]

_HOMES = {
    "Answer": "fusionnet.policy",
    "load_policy": "fusionnet.policy",
    "make_world": "fusionnet.simulation",
}

for _name, _module in (("PickPlace", "environment"), ("PickPlaceServo", "servo_environment")):
    gymnasium.register(
        f"fusionnet/{_name}-v0",
        entry_point=f"fusionnet.simulation.{_module}:{_name}",
        vector_entry_point=f"fusionnet.simulation.vector:{_name}Vector",
    )


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusionnet' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
