"""Fixtures that several tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# A busy machine is slow; that says nothing about what is tested.
settings.register_profile("fusionnet", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("fusionnet")

REPOSITORY = Path(__file__).resolve().parent.parent

NAMED = os.environ.get("FUSIONNET_DATA")
"""Read once: tests run without the variable, and this folder may be asked for after one began."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="rewrite the files in tests/golden with what the code says now",
    )


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder with the treebank and the URDF; tests that need it skip where it is missing."""
    folder = Path(NAMED) if NAMED else REPOSITORY.parent / "shared" / "data"
    if not (folder / "treebank").is_dir():
        pytest.skip(f"no treebank in {folder} (set FUSIONNET_DATA to the folder that holds it)")
    return folder


@pytest.fixture(scope="session")
def pictures_here() -> None:
    """Skip where nothing can be rendered; the gate fails there, as it runs a command first."""
    from fusionnet.errors import RenderingError  # after the type checker's hook is in place
    from fusionnet.simulation import SceneRenderer

    try:
        SceneRenderer("nico", (64, 36)).close()
    except RenderingError as error:
        pytest.skip(f"no pictures here: {error}")


@pytest.fixture(autouse=True)
def no_data_by_default(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands find only the data that a test gives them, on every machine alike."""
    monkeypatch.delenv("FUSIONNET_DATA", raising=False)


@pytest.fixture
def golden(request: pytest.FixtureRequest):
    """Compare a text with `tests/golden/NAME`, or rewrite it under `--update-golden`.

    With a relative tolerance the text is one of numbers.
    """

    def check(name: str, text: str, tolerance: float | None = None) -> None:
        path = REPOSITORY / "tests" / "golden" / name
        if request.config.getoption("--update-golden"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert path.exists(), f"{path} is missing; run pytest --update-golden"
        known = path.read_text(encoding="utf-8")
        if tolerance is None:
            assert text == known
        else:
            numbers = [float(word) for word in text.split()]
            assert numbers == pytest.approx([float(w) for w in known.split()], rel=tolerance)

    return check
