"""The OpenCL drivers that are installed, and why one does not load.

A driver registers itself by a text file `NAME.icd` that holds the name of its library. OpenCL's loader passes over
a library that does not load, without a word. The files are looked for as ocl-icd does it, the loader in pyopencl's
wheels.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

_SYSTEM = "/etc/OpenCL/vendors"
_OWN = ".libs"  # in pyopencl's wheels, with the driver that they bring
_LOAD = "import ctypes, sys; ctypes.CDLL(sys.argv[1])"


@dataclass(frozen=True)
class Driver:
    """A registered driver. `problem` is why it does not load, or ""."""

    file: Path
    problem: str


def installed_drivers() -> list[Driver]:
    """All drivers that OpenCL's loader finds, tried one by one in processes of their own."""
    return [Driver(file, _problem(file)) for place in _places() for file in _icd_files(place)]


def limiting_variables() -> list[str]:
    """Those environment variables, as NAME=VALUE, that keep the loader from the system's drivers."""
    return [f"{name}={os.environ[name]}" for name in ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH") if os.environ.get(name)]


def _places() -> list[Path]:
    """Folders of .icd files, or one such file."""
    chosen = os.environ.get("OCL_ICD_VENDORS", "")
    if chosen and not Path(chosen).is_dir():
        return [Path(chosen)]
    wheel = find_spec("pyopencl")
    own = [Path(wheel.origin).parent / _OWN] if wheel and wheel.origin else []
    return [Path(chosen or os.environ.get("OPENCL_VENDOR_PATH") or _SYSTEM), *own]


def _icd_files(place: Path) -> list[Path]:
    return sorted(place.glob("*.icd")) if place.is_dir() else [place] if place.suffix == ".icd" else []


def _problem(file: Path) -> str:
    try:
        library = file.read_text(encoding="utf-8", errors="replace").strip()
    except OSError as error:
        return f"cannot be read: {(error.strerror or str(error)).lower()}"
    target = str(file.with_name(library)) if file.parent.name == _OWN else library  # the loader lies there itself
    done = subprocess.run([sys.executable, "-I", "-c", _LOAD, target], capture_output=True, text=True, errors="replace")
    if done.returncode < 0:
        return f"{library} ends the process that loads it, with signal {-done.returncode}"
    return done.stderr.strip().rpartition("\n")[2].removeprefix("OSError: ") if done.returncode else ""
