"""Many renders in one process do not grow its memory."""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from mmap import mmap
from pathlib import Path

import pytest

import pyrt

SCENE = {
    "film": {"resolution": [8, 8]},
    "objects": [{"type": "icosphere", "subdivisions": 1, "light": {"radiance": [1, 1, 1]}}],
}
ROOT = Path(__file__).parents[2]
WARM = 10  # renders until caches are filled
MIB = 1 << 20


def resident() -> int:
    """Bytes of this process's memory that are in use."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def growth(work: Callable[[], object], times: int) -> float:
    """MiB that so many calls leave behind."""
    for _ in range(WARM):
        work()
    before = resident()
    for _ in range(times):
        work()
    return (resident() - before) / MIB


def growths(times: int) -> dict[str, float]:
    """Of the pictures of one renderer, of renderers, and of something that does keep 1 MiB each time."""
    scene = pyrt.load_scene(SCENE)
    renderer = pyrt.Renderer(scene)
    kept = []
    with tempfile.TemporaryDirectory() as folder:

        def picture() -> None:
            renderer.render(4, checkpoint=f"{folder}/a.exr", checkpoint_every=0)
            renderer.render(16, noise=0.1).save(f"{folder}/a.png")

        def leak() -> None:
            kept.append(mmap(-1, MIB))
            kept[-1].write(b"x" * MIB)

        return {
            "pictures": growth(picture, times),
            "renderers": growth(lambda: pyrt.render(scene, spp=1), times),
            "leak": growth(leak, 20),
        }


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not tell memory use")
@pytest.mark.parametrize("times", [20, pytest.param(1000, marks=pytest.mark.slow)])
def test_renders_leave_no_memory_behind(times):
    """In a process of its own, as memory that others gave back would hide the growth."""
    code = f"import json; from tests.render.test_memory import growths; print(json.dumps(growths({times})))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    assert found["pictures"] < 4
    assert found["renderers"] < 8
    assert found["leak"] > 15
