"""FusionNet: a sentence and a picture move a block.

    from fusionnet import load_policy, make_world

    policy = load_policy("compact")
    world = make_world(robot="nico", seed=24)
    answer = policy(world.image("left_eye"), "put the red pyramid on the blue cube")
    episode = world.execute(answer)

The rooms below are imported only when one of their names is asked for, so that
`import fusionnet` is instant.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fusionnet.policy import Answer, load_policy
    from fusionnet.simulation import make_world

__all__ = ["Answer", "load_policy", "make_world", "register_environments"]

_HOMES = {
    "Answer": "fusionnet.policy",
    "load_policy": "fusionnet.policy",
    "make_world": "fusionnet.simulation",
}


def register_environments() -> None:
    """Make our environments known to Gymnasium, which calls this when it is imported."""
    import gymnasium

    rooms = "fusionnet.simulation"
    homes = {"PickPlace": f"{rooms}.environment", "PickPlaceServo": f"{rooms}.servo_environment"}
    for name, home in homes.items():
        if f"fusionnet/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"fusionnet/{name}-v0",
                entry_point=f"{home}:{name}",
                vector_entry_point=f"{rooms}.vector:{name}Vector",
            )


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusionnet' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
