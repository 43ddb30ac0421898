"""Kernels are linked on a machine without `ld`: on an empty PATH, and with the machine's toolchain hidden (slow)."""

import os
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec

import pytest

from pyrt.device import choose_device

needs_wheel = pytest.mark.skipif(find_spec("ziglang") is None, reason="the extra `linker` is not installed")

NEGATE = """
import sys
import numpy as np
import pyopencl as cl
from pyrt.device import choose_device
from pyrt.errors import DeviceError
from pyrt.toolchain import ensure_linker

info = choose_device()
if "without wheel" in sys.argv:
    sys.modules["ziglang"] = None
if "unprepared" not in sys.argv:
    try:
        ensure_linker(info.version)
    except DeviceError as error:
        sys.exit(str(error))
context = cl.Context([info.raw])
queue = cl.CommandQueue(context)
data = np.arange(64, dtype=np.float32)
flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
buffer = cl.Buffer(context, flags, hostbuf=data)
source = "kernel void negate(global float *x) { x[get_global_id(0)] *= -1; }"
cl.Program(context, source).build(cache_dir=False).negate(queue, (64,), (64,), buffer)
result = np.empty_like(data)
cl.enqueue_copy(queue, result, buffer).wait()
assert (result == -data).all()
"""


# Hides linkers, compilers and what they link, in a mount namespace that ends with the command.
HIDE = """
cd /usr
for file in local/bin/ld bin/ld bin/ld.[!s]* bin/*-ld bin/*-ld.* bin/*gcc* bin/*g++* bin/*clang* \\
    lib/gcc/*/*/libgcc* lib/gcc/*/*/crt* lib/*/crt?.o lib/*/libc.so lib/*/libc.a
do
    if [ -f "$file" ] && [ ! -L "$file" ]; then mount --bind /dev/null "$file"; fi
done
cd "$OLDPWD"
if command -v ld || command -v gcc; then exit 99; fi
exec "$@"
"""


@pytest.fixture
def bare(tmp_path):
    """Runs a Python command with empty caches and the given PATH. Skips where PoCL 3 is not the device."""
    if "PoCL 3." not in choose_device().version:
        pytest.skip("the device here is not PoCL 3, which is what needs a linker")
    caches = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "POCL_CACHE_DIR": str(tmp_path / "pocl")}

    def run(*arguments, path="/nowhere", wrapper=()):
        environment = {**os.environ, **caches, "PATH": path}
        command = [*wrapper, sys.executable, *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True)

    return run


@needs_wheel
def test_the_wheels_linker_links_a_kernel(bare):
    done = bare("-c", NEGATE)
    assert (done.returncode, done.stderr) == (0, "")


def test_no_linker_is_a_sentence(bare):
    done = bare("-c", NEGATE, "without wheel")
    assert done.returncode == 1
    assert "pip install ziglang" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_unprepared_process_is_aborted(bare):
    assert bare("-c", NEGATE, "unprepared").returncode == -signal.SIGABRT


@pytest.mark.slow
@needs_wheel
def test_a_picture_without_toolchain(bare, tmp_path):
    unshare = shutil.which("unshare")
    if not unshare or subprocess.run([unshare, "--mount", "true"], capture_output=True).returncode:
        pytest.skip("needs root and the right to mount")
    wrapper = [unshare, "--mount", "sh", "-c", HIDE, "sh"]
    assert bare("-c", NEGATE, "unprepared", path="/usr/bin:/bin", wrapper=wrapper).returncode == -signal.SIGABRT
    picture = tmp_path / "picture.exr"
    render = ["-m", "pyrt", "render", "scenes/cornell.json", "--size", "32x32", "--spp", "1", "-o", str(picture)]
    done = bare(*render, path="/usr/bin:/bin", wrapper=wrapper)
    assert done.returncode == 0, done.stderr
    assert picture.exists()
    done = bare("-m", "pyrt", "doctor", path="/usr/bin:/bin", wrapper=wrapper)
    assert done.returncode == 0, done.stderr
    assert "ok      linker: " in done.stdout
    assert "ziglang" in done.stdout
