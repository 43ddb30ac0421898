"""Many renders in one process do not grow its memory."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pyrt

SCENE = pyrt.load_scene(
    {
        "film": {"resolution": [8, 8]},
        "objects": [{"type": "icosphere", "subdivisions": 1, "light": {"radiance": [1, 1, 1]}}],
    }
)
WARM = 10  # renders until caches are filled
MIB = 1 << 20

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not tell memory use")


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


COUNTS = [30, pytest.param(1000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("times", COUNTS)
def test_a_renderers_pictures(times, tmp_path):
    renderer = pyrt.Renderer(SCENE)

    def work() -> None:
        renderer.render(4, checkpoint=tmp_path / "a.exr", checkpoint_every=0)
        renderer.render(16, noise=0.1).save(tmp_path / "a.png")

    assert growth(work, times) < 4


@pytest.mark.parametrize("times", COUNTS)
def test_renderers(times):
    assert growth(lambda: pyrt.render(SCENE, spp=1), times) < 8


def test_a_leak_is_seen():
    kept = []
    assert growth(lambda: kept.append(np.ones((1 << 20,), np.uint8)), 30) > 25
