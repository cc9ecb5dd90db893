"""A folder imports only what stands above it in the house's list, and physics needs no PyTorch."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parent.parent / "src" / "fusionnet"

HOUSE = (
    "errors",
    "randomness",
    "catalogue",
    "files",
    "provenance",
    "geometry",
    "rcl",
    "blocks",
    "corpora",
    "sentences",
    "robots",
    "simulation",
    "views",
    "dataset",
    "models",
    "training",
    "policy",
    "evaluation",
    "experiments",
    "report",
    "apps",
)
WITHOUT_TORCH = HOUSE[: HOUSE.index("models")]
DISTRIBUTIONS = {"cv2": "opencv-python-headless", "PIL": "pillow"}
TORCH = {"torch", "torchvision", "lightning"}

# `fusionnet/__init__.py` is the front door: it hands out names from any room but the apps.
MODULES = sorted(path for path in SOURCE.rglob("*.py") if path != SOURCE / "__init__.py")


def room_of(path: Path) -> str:
    """The room a module stands in: `blocks` for blocks/grid.py, `errors` for errors.py."""
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Line and dotted name of every import in a file, also of those inside functions."""
    package = ("fusionnet", *path.relative_to(SOURCE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, name.name) for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            if module == "fusionnet":
                yield from ((node.lineno, f"fusionnet.{name.name}") for name in node.names)
            else:
                yield node.lineno, module


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_a_module_imports_only_what_stands_above_it(path: Path) -> None:
    room = room_of(path)
    assert room in HOUSE, f"{room} has no place in the house; add it to the list where it belongs"
    for line, name in imported(path):
        parts = name.split(".")
        if parts[0] == "fusionnet" and len(parts) > 1 and parts[1] in HOUSE:
            assert HOUSE.index(parts[1]) <= HOUSE.index(room), f"{path}:{line} imports {name}"
        if room in WITHOUT_TORCH:
            assert parts[0] not in TORCH, f"{path}:{line} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_nothing_is_pickled(path: Path) -> None:
    names = {name.split(".")[0] for _, name in imported(path)}
    assert not names & {"pickle", "cloudpickle", "dill", "shelve"}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            called = f"{node.value.id}.{node.attr}"
            forbidden = {"torch.save", "torch.load", "joblib.dump", "joblib.load"}
            assert called not in forbidden, f"{path}:{node.lineno}"
        if isinstance(node, ast.ImportFrom) and node.module == "joblib":
            assert not {name.name for name in node.names} & {"dump", "load"}, path
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            value = node.value.value if isinstance(node.value, ast.Constant) else None
            assert value is False, f"{path}:{node.lineno} allows pickles"


def test_what_is_imported_is_what_is_declared() -> None:
    project = tomllib.loads((SOURCE.parent.parent / "pyproject.toml").read_text())["project"]
    declared = {re.split(r"[<>=~!\[ ]", line)[0] for line in project["dependencies"]}
    extras = project["optional-dependencies"]
    optional = {re.split(r"[<>=~!\[ ]", e)[0] for e in extras["cluster"] + extras["hub"]}
    packages = {name.split(".")[0] for path in MODULES for _, name in imported(path)}
    needed = {DISTRIBUTIONS.get(name, name) for name in packages - sys.stdlib_module_names}
    needed = {name.replace("_", "-") for name in needed} - {"fusionnet"}
    assert needed <= declared | optional, "declare these in pyproject.toml"
    indirect = {"daqp", "faster-coco-eval", "quadprog", "tensorboard"}
    assert declared - needed == indirect, "nothing imports these"


def test_the_test_sees_an_import_that_goes_down(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(f"{__name__}.SOURCE", tmp_path)
    bad = tmp_path / "blocks" / "grid.py"
    bad.parent.mkdir()
    bad.write_text("def late():\n    from fusionnet.policy import load_policy\n")
    with pytest.raises(AssertionError, match="imports fusionnet.policy"):
        test_a_module_imports_only_what_stands_above_it(bad)
    bad.write_text("from .. import training\n")
    with pytest.raises(AssertionError, match="imports fusionnet.training"):
        test_a_module_imports_only_what_stands_above_it(bad)
    bad.write_text("import torch.nn\n")
    with pytest.raises(AssertionError, match="imports torch.nn"):
        test_a_module_imports_only_what_stands_above_it(bad)
