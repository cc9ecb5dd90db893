"""`fusionnet doctor`: what works on this machine, and how to mend what does not."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from fusionnet.apps.cli import EXIT_MISSED, EXIT_REACHED

EGL_PACKAGES = ("libegl1", "libgl1", "libgl1-mesa-dri", "libopengl0")
"""Debian's and Ubuntu's names for a software renderer that needs no display."""

FREE_GIGABYTES = 1.0
"""Below this a run's folder may not fit."""

_RENDER = """
import mujoco
from fusionnet.simulation.offscreen import Offscreen, backend
Offscreen(mujoco.MjModel.from_xml_string("<mujoco/>"), (64, 48)).picture()
print(backend())
"""


@dataclass(frozen=True, kw_only=True)
class DoctorConfig:
    """What to do about what is found."""

    mend: bool = False
    """Install a software renderer with apt-get, if none works and we may (as root, or with
    sudo that asks for no password)."""

    json: bool = False
    """Print one JSON object instead of the table."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: What was looked at.
        works: Whether it does; None for something that may be missing.
        found: What was found.
        remedy: One line that mends it, where something is wrong.
    """

    name: str
    works: bool | None
    found: str
    remedy: str = ""


def doctor(config: DoctorConfig) -> int:
    """Say what works on this machine and how to mend what does not."""
    if config.mend and not _rendering().works:
        _install_renderer()
    checks = list(_checks())
    if config.json:
        print(json.dumps({"checks": [asdict(check) for check in checks]}))
    else:
        _print(checks)
    return EXIT_MISSED if any(check.works is False for check in checks) else EXIT_REACHED


def _checks() -> Iterator[Check]:
    python = ".".join(map(str, sys.version_info[:3]))
    yield Check("Python", sys.version_info >= (3, 11), python, "FusionNet needs 3.11 or newer.")
    yield _packages()
    yield _rendering()
    yield _device()
    yield _weights()
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    yield Check(
        "disk", free >= FREE_GIGABYTES, f"{free:.0f} GB free here", "Make room, or use --out."
    )
    yield _treebank()


def _packages() -> Check:
    """Whether every package that this one requires is there."""
    try:
        required = requires("fusionnet") or []
    except PackageNotFoundError:
        return Check("packages", False, "fusionnet is not installed", "pip install -e .")
    missing, found = [], []
    for line in required:
        if ";" in line:  # an extra, or another platform
            continue
        name = line.replace(">", " ").replace("=", " ").replace("~", " ").split()[0]
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    if missing:
        return Check("packages", False, f"missing: {', '.join(missing)}", "pip install -e .")
    shown = [p for p in found if p.split()[0] in ("torch", "mujoco", "numpy")]
    return Check("packages", True, ", ".join(shown))


def _rendering() -> Check:
    """Whether a picture can be rendered; tried in a process of its own, for drivers that crash."""
    tried = subprocess.run([sys.executable, "-c", _RENDER], capture_output=True, text=True)
    if tried.returncode == 0:
        return Check("rendering", True, f"MuJoCo with {tried.stdout.strip()}")
    lines = tried.stderr.strip().splitlines() or [f"ended with status {tried.returncode}"]
    return Check("rendering", False, lines[-1].rpartition("Error: ")[2], _renderer_remedy())


def _renderer_remedy() -> str:
    install = f"apt-get install {' '.join(EGL_PACKAGES)}"
    return f"Debian, Ubuntu: sudo {install}; elsewhere: the Mesa packages with EGL."


def _install_renderer() -> None:
    """Install a software renderer where that is possible without asking anybody."""
    prefix = _root_prefix()
    if shutil.which("apt-get") is None or prefix is None:
        return
    print(f"Installing {' '.join(EGL_PACKAGES)} ...", file=sys.stderr)
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    install = [*prefix, "apt-get", "install", "-qq", "-y", "--no-install-recommends", *EGL_PACKAGES]
    for command in ([*prefix, "apt-get", "update", "-qq"], install):
        subprocess.run(command, env=quiet, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def _root_prefix() -> list[str] | None:
    """What to put before a command to run it as root; None where we may not."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") is None:
        return None
    asked = subprocess.run(["sudo", "--non-interactive", "true"], capture_output=True)
    return ["sudo", "--non-interactive"] if asked.returncode == 0 else None


def _device() -> Check:
    import torch

    if torch.cuda.is_available():
        return Check("PyTorch", True, f"{torch.cuda.get_device_name()}, CUDA {torch.version.cuda}")
    threads = torch.get_num_threads()
    return Check("PyTorch", True, f"processor, {threads} thread{'' if threads == 1 else 's'}")


def _weights() -> Check:
    """Whether the weights that come with the package are there and whole."""
    from fusionnet.errors import FusionNetError
    from fusionnet.policy import load_policy

    try:
        load_policy("compact")
    except FusionNetError as error:
        return Check("weights", False, str(error), "Install the package again.")
    return Check("weights", True, "the policy 'compact' loads")


def _treebank() -> Check:
    """Whether the treebank is where the environment says; nothing needs it to run."""
    from fusionnet.corpora import named_data

    named = named_data()
    if named is None:
        return Check("treebank", None, "not named (optional; FUSIONNET_DATA or --data DIR)")
    there = any((named / place / "commands.txt").is_file() for place in ("treebank", "."))
    return Check("treebank", None, f"{'found in' if there else 'not in'} {named}")


def _print(checks: list[Check]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table.grid(padding=(0, 1))
    marks = {True: "[green]✓[/green]", False: "[bold red]✗[/bold red]", None: "[dim]·[/dim]"}
    for check in checks:
        remedy = f"\n[yellow]{check.remedy}[/yellow]" if check.works is False else ""
        table.add_row(marks[check.works], check.name, check.found + remedy)
    console = Console(highlight=False)
    console.print(table, soft_wrap=not console.is_terminal)
