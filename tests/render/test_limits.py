"""What is too large is refused beforehand, in one sentence, and what a system forbids does not end the process."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import pyrt
from pyrt import device_scene
from pyrt.device import Device
from pyrt.errors import DeviceError

resource = pytest.importorskip("resource", reason="the system has no limits for processes")

ROOT = Path(__file__).parents[2]
BALL = {"objects": [{"type": "icosphere", "subdivisions": 3, "light": {"radiance": [1, 1, 1]}}]}


def test_a_scene_too_large_for_a_buffer_is_refused_before_its_tree_is_built(monkeypatch):
    scene, device = pyrt.load_scene(BALL), Device()
    triangles = 64 * 20 * 4**3
    device.info = replace(device.info, max_alloc=triangles - 1)
    monkeypatch.setattr(device_scene, "pack_scene", lambda *_: pytest.fail("it was built"))
    with pytest.raises(DeviceError, match="triangles needs 0 MiB, one buffer holds at most 0 MiB"):
        pyrt.Renderer(scene, device)
    device.info = replace(device.info, max_alloc=triangles)
    with pytest.raises(pytest.fail.Exception):
        pyrt.Renderer(scene, device)


def run(limit: int, *words: str) -> subprocess.CompletedProcess[str]:
    """pyrt, where files may have so many bytes."""

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    command = [sys.executable, "-m", "pyrt", *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, preexec_fn=limited)


def test_a_limit_for_files_keeps_the_old_picture(tmp_path):
    words = ["render", "example:cornell", "--spp", "1", "-q", "-o", str(tmp_path / "a.npy"), "--size"]
    assert run(2**22, *words, "16x16").returncode == 0
    before = (tmp_path / "a.npy").read_bytes()
    done = run(2**22, *words, "640x640")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "a.npy: cannot be written: " in done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["a.npy"]
    assert (tmp_path / "a.npy").read_bytes() == before


def test_no_compiler_is_run_where_it_would_abort():
    done = run(2**20, "render", "example:cornell")
    assert done.returncode == 4
    assert done.stderr == (
        "pyrt: no room for compiled kernels: files of this process may have 1048576 bytes, expected 4194304 or more; "
        "run: ulimit -f unlimited\n"
    )
