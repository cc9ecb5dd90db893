"""The world that the options of `fusionnet run` name."""

from dataclasses import dataclass
from pathlib import Path

from fusionnet.blocks import Layout, read_layout
from fusionnet.corpora import Command, load_corpus
from fusionnet.errors import InputError, UnknownNameError


@dataclass(frozen=True)
class Setting:
    """The world as it is before the command, as far as it is known.

    Attributes:
        origin: Where it came from, in words.
        layout: The blocks; None when a seed or a picture stands for them.
        recorded: The corpus's commands for the scene.
    """

    origin: str
    layout: Layout | None = None
    recorded: tuple[Command, ...] = ()


def setting_of(
    *,
    scene: int | None,
    corpus: str,
    data: Path | None,
    layout: Path | None,
    image: Path | None,
    seed: int | None,
) -> Setting:
    """The world that the options name.

    Raises:
        InputError: If they name two worlds, a corpus without a scene of it, or a layout that
            cannot be.
        UnknownNameError: If there is no such scene or corpus.
        DataError: If the corpus's files are missing or damaged.
    """
    named = {"--scene": scene, "--layout": layout, "--image": image}
    given = [option for option, value in named.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} name two worlds; give one of them.")
    check_scene_named(scene, corpus, data)
    if image is not None:
        return Setting(f"picture {image.name}")
    if layout is not None:
        return Setting(f"layout {layout.name}", read_layout(layout))
    if scene is None and seed is not None:
        return Setting(f"random, seed {seed}")
    scene = 1 if scene is None else scene
    loaded = load_corpus(corpus, data)
    if scene not in loaded.scenes:
        known = sorted(loaded.scenes)
        raise UnknownNameError(
            f"No scene {scene} in the corpus {corpus!r}; its {len(known)} scenes have the "
            f"numbers {known[0]} to {known[-1]}."
        )
    recorded = tuple(c for c in loaded.commands if c.scene.id == scene)
    return Setting(f"{scene} of {corpus}", loaded.scenes[scene].before, recorded)


def check_scene_named(scene: int | None, corpus: str, data: Path | None) -> None:
    """Refuse a corpus of which no scene is asked for.

    Raises:
        InputError: If there is no scene, but another corpus than the default or a folder of one.
    """
    named = {f"--corpus {corpus}": corpus != "examples", f"--data {data}": data is not None}
    options = " and ".join(option for option, is_named in named.items() if is_named)
    if scene is None and options:
        raise InputError(
            f"Without a scene {options} would do nothing; add --scene N, or leave {options} out."
        )
