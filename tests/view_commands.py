"""The command that makes views of small rendered photographs."""

from pathlib import Path


def import_command(folder: Path, out: Path, *more: str) -> list[str]:
    """`views import` of photographs so small that their corners hardly tell a camera's place."""
    return ["views", "import", str(folder), "--out", str(out), "--uncertain", "5", *more]
