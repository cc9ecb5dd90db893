"""FusionNet: a sentence and a picture move a block.

    from fusionnet import load_policy, make_world

    policy = load_policy("compact")
    world = make_world(robot="nico", seed=24)
    answer = policy(world.image("left_eye"), "put the red pyramid on the blue cube")
    episode = world.execute(answer)

The rooms below are imported only when one of their names is asked for, so that
`import fusionnet` is instant. It makes `fusionnet/PickPlace-v0` and
`fusionnet/PickPlaceServo-v0` known to Gymnasium, whichever of the two is imported first.
"""

import importlib
import importlib.util
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fusionnet.policy import Answer, load_policy
    from fusionnet.simulation import make_world

__all__ = ["Answer", "load_policy", "make_world"]

_HOMES = {
    "Answer": "fusionnet.policy",
    "load_policy": "fusionnet.policy",
    "make_world": "fusionnet.simulation",
}


def _register_environments() -> None:
    """Make our environments known to Gymnasium."""
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


class _GymnasiumFinder:
    """Finds Gymnasium as Python does, and registers our environments when it has been imported.

    Gymnasium has no plugins since 1.0, and to import it here would cost every command a second.
    """

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        if name != "gymnasium":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def execute_and_register(module: Any) -> None:
                execute(module)
                _register_environments()

            spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


if "gymnasium" in sys.modules:
    _register_environments()
else:
    sys.meta_path.insert(0, _GymnasiumFinder())


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusionnet' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
