"""The report of `pyrt doctor` on this machine, and on one where something is missing or ends the process."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from pyrt.checkup import device_report, doctor_report
from pyrt.device import choose_device
from pyrt.doctor import probe
from pyrt.drivers import installed_drivers
from tests.device.probe import device
from tests.device.test_doctor import edited

pytestmark = pytest.mark.skipif(
    "PoCL 3." not in choose_device().version or not sys.platform.startswith("linux"),
    reason="the device here is not PoCL 3, which is what needs a linker",
)


@pytest.fixture
def icd_files(tmp_path, monkeypatch):
    """A folder that OpenCL's loader looks into for drivers."""
    folder = tmp_path / "vendors"
    folder.mkdir()
    monkeypatch.setenv("OCL_ICD_VENDORS", str(folder))
    return folder


def doctor(tmp_path: Path, **environment: str) -> tuple[str, int]:
    """What a new process with empty caches prints, and its exit code."""
    caches = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "POCL_CACHE_DIR": str(tmp_path / "pocl")}
    command = [sys.executable, "-m", "pyrt", "doctor"]
    done = subprocess.run(command, env={**os.environ, **caches, **environment}, capture_output=True, text=True)
    assert done.stderr == ""
    return done.stdout, done.returncode


def test_of_this_machine():
    text, sound = doctor_report()
    assert sound
    assert "broken" not in text
    assert text.splitlines()[0] == "drivers"
    assert "\n  ok      linker: " in text
    assert all(f"\n  {finding}" in text for finding in probe(device()))
    assert text.endswith("\npyrt can render here")


def test_of_a_broken_device():
    with edited("probe.cl", "fma1(a, b, c)", "a * b + c"):
        lines, sound = device_report()
    assert not sound
    assert any(
        line.startswith("  broken  fused products and sums that round once: missing, so that rays could")
        for line in lines
    )


def test_of_a_device_that_there_is_not():
    text, sound = doctor_report("no such device")
    assert not sound
    assert '  broken  no OpenCL device matches "no such device"; there are 0: ' in text
    assert text.endswith("choose another --device")


def test_a_driver_whose_library_is_missing_is_named(icd_files):
    (icd_files / "vendor.icd").write_text("libvendor.so.1\n")
    text, sound = doctor_report()
    assert sound  # by the other driver
    assert f"  note    {icd_files}/vendor.icd: libvendor.so.1: cannot open shared object file" in text


def test_a_driver_that_ends_the_process_is_named(icd_files, tmp_path):
    compiler = next((name for name in ("cc", "gcc", "clang") if shutil.which(name)), None)
    if compiler is None:
        pytest.skip("needs a C compiler to make such a driver")
    source, library = tmp_path / "abort.c", icd_files / "libabort.so"
    source.write_text("#include <stdlib.h>\n__attribute__((constructor)) static void end(void) { abort(); }\n")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source], check=True)
    (icd_files / "vendor.icd").write_text(str(library))
    assert f"{library} ends the process that loads it, with signal 6" in [d.problem for d in installed_drivers()]
    text, sound = doctor_report()
    assert not sound
    assert "  broken  the self-test ended with SIGABRT" in text


def test_hidden_drivers(tmp_path):
    text, status = doctor(tmp_path, OCL_ICD_VENDORS="/nowhere")
    assert status == 4
    assert "  note    OCL_ICD_VENDORS=/nowhere is where they are looked for; run: unset OCL_ICD_VENDORS" in text
    assert "  broken  no OpenCL platform found" in text
    assert "run: pip install 'pyopencl[pocl]'" in text


def as_if(tmp_path: Path, line: str) -> dict[str, str]:
    """Environment in which every Python process begins with the line."""
    (tmp_path / "sitecustomize.py").write_text(line)
    return {"PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}


def test_a_hidden_linker(tmp_path):
    no_wheel = as_if(tmp_path, "import sys; sys.modules['ziglang'] = None")
    text, status = doctor(tmp_path, PATH="/nowhere", **no_wheel)
    assert status == 4
    assert "  broken  PoCL 3.0 needs a linker" in text
    assert "run `pip install ziglang`" in text


def test_an_abort_is_a_line_of_the_report(tmp_path):
    """PoCL without a linker aborts, as `test_linker.py` shows."""
    unprepared = as_if(tmp_path, "import pyrt.toolchain; pyrt.toolchain.ensure_linker = lambda version: None")
    text, status = doctor(tmp_path, PATH="/nowhere", **unprepared)
    assert status == 4
    assert "  broken  the self-test ended with SIGABRT (" in text
    assert f"run: rm -r {tmp_path / 'pocl'}" in text


@pytest.mark.skipif(find_spec("ziglang") is None, reason="the extra `linker` is not installed")
def test_the_wheels_linker_and_a_cache_that_cannot_be_written_to(tmp_path):
    text, status = doctor(tmp_path, PATH="/nowhere", POCL_CACHE_DIR="/proc/none")
    assert status == 0
    assert "/ziglang/zig ld.lld\n" in text
    assert "  note    /proc/none is full or cannot be written to, so that every start compiles anew" in text
