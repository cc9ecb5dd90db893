"""A corpus in the treebank's format, of a few groups of our own, for tests of data sets."""

from pathlib import Path

GROUPS = (1, 3, 4, 5, 2)
"""Three for training, one for validation, one for testing."""

_TREE = (
    "(event: (action: move (token: 1)) (entity: (color: {} (token: 3)) (type: {} (token: 4))) "
    "(destination: (spatial-relation: (relation: above (token: 5)) "
    "(entity: (color: {} (token: 7)) (type: cube (token: 8))))))"
)


IMPOSSIBLE = "(event: (action: take) (entity: (color: magenta) (type: cube)))"
"""A tree that no layout of the tiny treebank has a block for."""


def ask_the_impossible(folder: Path, *commands: int) -> Path:
    """Give some of a tiny treebank's commands (all by default) a tree that cannot be executed."""
    file = folder / "annotation.txt"
    rows = [line.split("\t") for line in file.read_text().splitlines()]
    trees = [IMPOSSIBLE if not commands or int(row[0]) in commands else row[2] for row in rows]
    lines = [f"{row[0]}\trcl\t{tree}" for row, tree in zip(rows, trees, strict=True)]
    file.write_text("\n".join(lines) + "\n")
    return folder


def write_tiny_treebank(folder: Path) -> Path:
    """Five groups of five layouts; in each, two sentences for each of four moves."""
    configuration, commands, annotation, number = [], [], [], 0
    for group in GROUPS:
        red, yellow = (6, group % 8, 0), (1, 7 - group % 8, 0)
        blue, green = (2, 3, 0), (4, 1, 0)
        moves = [("red", "cube", "blue"), ("red", "cube", "green")]
        moves += [("yellow", "prism", "blue"), ("yellow", "prism", "green")]
        places = {"red": red, "yellow": yellow, "blue": blue, "green": green}
        tables = [places]
        for index, (moved, kind, below) in enumerate(moves):
            x, y, _ = places[below]
            tables.append(places | {moved: (x, y, 1)})
            for verb in ("move", "put"):
                number += 1
                scene = (group - 1) * 8 + 2 * index + 1
                thing = "pyramid" if kind == "prism" else kind
                said = f"{verb} the {moved} {thing} onto the {below} cube"
                commands.append(f"{number}\t{scene}\t{said}")
                annotation.append(f"{number}\trcl\t{_TREE.format(moved, kind, below)}")
        for layout, table in enumerate(tables, 1):
            lines = [f"{group}\t{layout}", "7\t7\t7\tO"]
            for color, (x, y, z) in sorted(table.items(), key=lambda item: item[1]):
                shape = 2 if color == "yellow" else 1
                lines.append(f"{x}\t{y}\t{z}\t{color[0].upper()}\t{shape}")
            configuration.append("\n".join(lines) + "\n")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "configuration.txt").write_text("\n".join(configuration))
    (folder / "commands.txt").write_text("\n".join(commands) + "\n")
    (folder / "annotation.txt").write_text("\n".join(annotation) + "\n")
    return folder
