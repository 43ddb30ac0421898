"""A linker for PoCL, whatever the machine has.

PoCL (3.0 to 7) makes a shared library of every kernel variant at its first launch. It runs the first `ld` on PATH as

    ld … -shared -o …/tempfile_1.so -L… …/tempfile_2.so.o -lgcc --as-needed -lgcc_s --no-as-needed -lc …

and **aborts the process** where `ld`, or the development files of libgcc or libc, are missing. Kernels need none of
those libraries: what they leave undefined (memset, say) is found in the running process when PoCL loads them. So pyrt
puts a folder first on this process's PATH whose `ld` is a short script. It drops every `-l…` from a command that
links a kernel, hands all other commands on as they are, and runs the system's linker, or else the one in the
`ziglang` wheel. All machines take this one way, so it is tested on all of them, and a link takes 3 ms instead of 12.

A linker is believed once it has linked an empty object through the script. The script then stays in the user's cache
folder, under a name made of the linker's path, size and time. There is no need to try OpenCL itself in a subprocess.
"""

from __future__ import annotations

import atexit
import math
import os
import re
import shlex
import shutil
import struct
import sys
import tempfile
import zlib
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from pyrt.errors import DeviceError, UsageError

_PREFIX = "pyrt-ld-"
_ROOM = 2**24  # bytes free for compiled kernels; those of a scene take less than 1 MiB
_FILE = 2**22  # bytes of one file of theirs, or more

_SCRIPT = """#!/bin/sh
# Made by pyrt: links PoCL's kernels without libraries and hands every other command on.
case "$*" in
*/tempfile_*.so.o\\ -l*)
    for argument do
        shift
        case $argument in -l*) ;; *) set -- "$@" "$argument" ;; esac
    done ;;
esac
exec {linker} "$@"
"""


def ensure_linker(pocl_version: str) -> None:
    """Make sure that PoCL can link kernels in this process: call it before the first launch on a PoCL CPU device.

    Puts a folder first on PATH (of this process and its children). Later calls do nothing. `pocl_version`, the
    platform's version string, is for the message.

    Raises:
        DeviceError: no working linker; the message names two commands that bring one.
    """
    if sys.platform != "linux":
        return
    path = os.environ.get("PATH", os.defpath).split(os.pathsep)
    if _is_ours(path[0]) and Path(path[0], "ld").exists():
        return
    for linker in _linkers([folder for folder in path if not _is_ours(folder)]):
        if folder := _install(linker):
            os.environ["PATH"] = os.pathsep.join([str(folder), *path])
            return
    name = re.search(r"PoCL [\w.]+", pocl_version, re.IGNORECASE)
    raise DeviceError(
        f"{name[0] if name else 'PoCL'} needs a linker (`ld`) to finish its kernels and found none that works; "
        "run `pip install ziglang` or `apt-get install binutils`"
    )


def limit_threads(count: int) -> None:
    """Make PoCL use so many threads in this process: call it before the first look for platforms, which reads this.

    Raises:
        UsageError: not even one, or more than the machine has cores.
    """
    cores = os.cpu_count() or count
    if not 1 <= count <= cores:
        raise UsageError(f"threads: expected a whole number from 1 to {cores}, as many as there are cores, got {count}")
    os.environ["POCL_MAX_PTHREAD_COUNT"] = os.environ["POCL_CPU_MAX_CU_COUNT"] = str(count)  # PoCL 3 and 4, and 5 on


def linker_in_use() -> str:
    """The command that links PoCL's kernels, once there was an `ensure_linker`; "" where pyrt need not bring one."""
    script = Path(os.environ.get("PATH", "").partition(os.pathsep)[0], "ld")
    if not (_is_ours(str(script.parent)) and script.exists()):
        return ""
    return " ".join(shlex.split(script.read_text().rpartition("exec ")[2])[:-1])


def kernel_cache() -> Path:
    """The folder where PoCL keeps compiled kernels."""
    chosen = os.environ.get("POCL_CACHE_DIR")
    return Path(chosen) if chosen else Path(_cache_home(), "pocl", "kcache")


def ensure_cache() -> None:
    """Make sure that PoCL and pyopencl can cache what they compile: call it before the first look for platforms.

    Where the cache folder cannot be written to, as for a user without a home, PoCL reports no device and pyopencl
    fails; where the disk is full, PoCL's compiler aborts the process. Then a folder of this process alone serves.

    Raises:
        DeviceError: the temporary folder is no better, or files of this process may not be large enough anywhere.
    """
    if (limit := _file_limit()) < _FILE:
        raise DeviceError(
            f"no room for compiled kernels: files of this process may have {limit} bytes, expected {_FILE} or more; "
            "run: ulimit -f unlimited"
        )
    folders = {"XDG_CACHE_HOME": _cache_home(), "POCL_CACHE_DIR": os.environ.get("POCL_CACHE_DIR")}
    unfit = [name for name, folder in folders.items() if folder and not _has_room(Path(folder))]
    if not unfit:
        return
    try:
        private = _private_folder()
    except OSError:
        private = None
    if private is None or not _has_room(private):
        raise DeviceError(
            f"no room for compiled kernels: {folders[unfit[0]]} and the folder for temporary files are full or cannot "
            f"be written to; expected {_ROOM >> 20} MiB free in one of them"
        )
    os.environ.update(dict.fromkeys(unfit, str(private)))


def _file_limit() -> float:
    """Bytes that a file may have which this process writes."""
    try:
        import resource
    except ImportError:  # not on Windows
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    return math.inf if limit == resource.RLIM_INFINITY else limit


def _has_room(folder: Path) -> bool:
    """Whether what is compiled can be written to the folder, which is made if need be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return os.access(folder, os.W_OK) and shutil.disk_usage(folder).free >= _ROOM
    except OSError:
        return False


def _cache_home() -> str:
    return os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache")


def _is_ours(folder: str) -> bool:
    return Path(folder).name.startswith(_PREFIX)


def _linkers(path: list[str]) -> Iterator[tuple[str, ...]]:
    """Commands that may link ELF objects, the system's first."""
    for name in ("ld", "ld.lld"):
        if program := shutil.which(name, path=os.pathsep.join(path)):
            yield (program,)
    wheel = find_spec("ziglang")
    if wheel and wheel.origin:
        yield (str(Path(wheel.origin).with_name("zig")), "ld.lld")


def _install(linker: tuple[str, ...]) -> Path | None:
    """A folder whose `ld` runs `linker` and was seen to link; None if `linker` does not work."""
    script = _SCRIPT.format(linker=shlex.join(linker))
    try:
        file = os.stat(linker[0])
    except OSError:
        return None
    key = zlib.crc32(f"{script} {file.st_size} {file.st_mtime_ns}".encode())
    cache = _cache_home()
    remembered = Path(cache, "pyrt", f"{_PREFIX}{key:08x}")
    if (remembered / "ld").exists():
        return remembered
    if os.path.isabs(cache) and _write_tested(remembered, script):  # not for a user without a home
        return remembered
    private = _private_folder()
    return private if _write_tested(private, script) else None


def _write_tested(folder: Path, script: str) -> bool:
    """Write `folder/ld` if it links; False if it does not, or if nothing can be written or executed there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as draft:
            ld = Path(draft, "ld")
            ld.write_text(script)
            ld.chmod(0o755)
            works = _links(ld)
            if works:
                ld.replace(folder / "ld")  # atomic: another process finds no script or a tested one
    except OSError:
        return False
    return works


def _links(ld: Path) -> bool:
    """Whether `ld` makes a shared library of an empty object, given the arguments that PoCL gives."""
    import subprocess  # 3 ms that only the first start on a machine has to pay

    source, target = ld.with_name("tempfile_in.so.o"), ld.with_name("tempfile_out.so")
    source.write_bytes(_empty_object())
    flags = ["--hash-style=both", "--eh-frame-hdr", "-shared", "-o", str(target)]
    command = [str(ld), *flags, str(source), "-lgcc", "--as-needed", "-lgcc_s", "--no-as-needed", "-lc"]
    done = subprocess.run(command, capture_output=True)
    return done.returncode == 0 and target.exists()


def _empty_object() -> bytes:
    """A relocatable ELF64 file for this machine that holds nothing but a table of section names."""
    with open("/proc/self/exe", "rb") as python:
        header = python.read(20)
    (machine,) = struct.unpack("<H", header[18:])
    names = b"\0.shstrtab\0"
    start = struct.pack("<HHIQQQIHHHHHH", 1, machine, 1, 0, 0, 64 + len(names), 0, 64, 0, 0, 64, 2, 1)
    table = struct.pack("<IIQQQQIIQQ", 1, 3, 0, 0, 64, len(names), 0, 0, 1, 0)
    return header[:16] + start + names + bytes(64) + table


def _private_folder() -> Path:
    """A folder of this process alone, for where the cache folder cannot hold programs."""
    folder = tempfile.mkdtemp(prefix=_PREFIX)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
