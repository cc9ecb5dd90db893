"""Where numbers come from: the commit, the versions and the machine."""

import os
import platform
import subprocess
import sys
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = (
    "fusionnet",
    "torch",
    "torchvision",
    "numpy",
    "mujoco",
    "mink",
    "opencv-python-headless",
    "pyarrow",
    "joblib",
    "optuna",
    "torchjd",
    "gensim",
)


def provenance() -> dict[str, Any]:
    """What numbers of this process are kept with, as JSON values.

    The commit is that of the first call; a plus says that the code was changed since.
    """
    return {**_unchanging(), "load": round(os.getloadavg()[0], 1), "device": _device()}


@cache
def _unchanging() -> dict[str, Any]:
    return {
        "commit": _commit(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "machine": platform.machine(),
        "processor": _processor(),
        "cores": os.cpu_count(),
    }


def _commit() -> str | None:
    try:
        commit = _git("rev-parse", "--short=12", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no", ":/src", ":/benchmarks")
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("+" if changed else "")


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def _device() -> str:
    """What PyTorch computes on; a process that has not imported it computes on the processor."""
    torch = sys.modules.get("torch")
    return torch.cuda.get_device_name() if torch and torch.cuda.is_available() else "cpu"
