"""The report of `pyrt doctor`: drivers, the kernel cache, and a self-test in a process that may crash."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from pyrt.device import Device, choose_device, list_devices
from pyrt.doctor import probe
from pyrt.drivers import installed_drivers, limiting_variables
from pyrt.errors import DeviceError
from pyrt.toolchain import ensure_cache, kernel_cache, linker_in_use

_HERE = str(Path(__file__).parents[1])
_SELF_TEST = """
import sys
sys.path.insert(0, sys.argv[1])
from pyrt.checkup import print_self_test
sys.exit(print_self_test(*sys.argv[2:]))
"""


def doctor_report(wanted: str | int | None = None) -> tuple[str, bool]:
    """Text about what this machine's OpenCL consists of, with what repairs it; and whether pyrt can render on it."""
    try:
        lines = ["drivers", *_drivers(), "kernel cache", *_cache()]
    except DeviceError as error:
        return f"broken  {error}", False
    tested, sound = _self_test(wanted)
    verdict = (
        "pyrt can render here" if sound else "pyrt cannot render here: see what is broken, or choose another --device"
    )
    return "\n".join([*lines, "devices", *tested, verdict]), sound


def device_report(wanted: str | int | None = None) -> tuple[list[str], bool]:
    """Lines about the devices and the arithmetic of the chosen one, in this process; and whether it is sound."""
    lines = []
    try:
        chosen = choose_device(wanted)
        for info in list_devices():
            lines.append(f"{'*' if info.index == chosen.index else ' '} {info.index}: {info.kind}  {info}")
        device = Device(chosen.index)
        if linker := chosen.is_pocl and linker_in_use():
            lines.append(f"  ok      linker: {linker}")
        findings = probe(device)
    except DeviceError as error:
        return [*lines, f"  broken  {error}"], False
    lines += [f"  {finding}" for finding in findings]
    return lines, all(finding.ok or not finding.required for finding in findings)


def print_self_test(wanted: str | None = None) -> int:
    """Prints `device_report`; returns an exit code."""
    lines, sound = device_report(wanted)
    print("\n".join(lines))
    return 0 if sound else DeviceError.exit_code


def _self_test(wanted: str | int | None) -> tuple[list[str], bool]:
    """`device_report` of a process of its own, as drivers have ways to end theirs."""
    command = [sys.executable, "-c", _SELF_TEST, _HERE, *([] if wanted is None else [str(wanted)])]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    lines = done.stdout.splitlines()
    if done.returncode not in (0, DeviceError.exit_code):
        last = done.stderr.strip().rpartition("\n")[2] or "no message"
        lines.append(
            f"  broken  the self-test ended with {_ending(done.returncode)} ({last}); the cache may be damaged, "
            f"run: rm -r {kernel_cache()}"
        )
    return lines, done.returncode == 0


def _ending(code: int) -> str:
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _drivers() -> list[str]:
    lines = []
    for driver in installed_drivers():
        cure = f": {driver.problem}; reinstall this driver, or remove the file"
        lines.append(f"  note    {driver.file}{cure}" if driver.problem else f"  ok      {driver.file}")
    for setting in limiting_variables():
        lines.append(f"  note    {setting} is where they are looked for; run: unset {setting.partition('=')[0]}")
    return lines or ["  broken  none is installed; run: pip install 'pyopencl[pocl]'"]


def _cache() -> list[str]:
    folder = kernel_cache()
    ensure_cache()
    if kernel_cache() != folder:
        return [f"  note    {folder} is full or cannot be written to, so that every start compiles anew"]
    return [f"  ok      {folder}: {_size(folder) / 2**20:.1f} MiB"]


def _size(folder: Path) -> int:
    """Bytes of the files in the folder, which other processes may be changing."""
    size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                size += os.stat(os.path.join(place, name)).st_size
    return size
