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

import numpy as np
import pytest

import pyrt

SCENE = {
    "film": {"resolution": [8, 8]},
    "objects": [{"type": "icosphere", "subdivisions": 1, "light": {"radiance": [1, 1, 1]}}],
}
ROOT = Path(__file__).parents[2]
WARM = 10  # renders until caches are filled
MIB = 1 << 20
BUILD = 1 / 24  # MiB: PoCL keeps 25 KiB of each program that it builds, and never gives them back


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
    """Of the pictures of one renderer, of renderers, of ray queries, of scenes and tracers that come and go, and of
    something that does keep 1 MiB each time."""
    scene = pyrt.load_scene(SCENE)
    renderer = pyrt.Renderer(scene)
    mesh = scene.shapes[0]
    tracer = pyrt.RayTracer(mesh.vertices, mesh.triangles)
    origins, directions = np.zeros((1000, 3)), np.ones((1000, 3))
    kept = []
    with tempfile.TemporaryDirectory() as folder:

        def picture() -> None:
            renderer.render(4, checkpoint=f"{folder}/a.exr", checkpoint_every=0)
            renderer.render(16, noise=0.1).save(f"{folder}/a.png")

        def queries(tracer: pyrt.RayTracer) -> None:
            tracer.closest(origins, directions)
            tracer.occluded(origins, directions)
            tracer.all_hits(origins, directions)

        def come_and_go() -> None:
            mesh = pyrt.load_scene(SCENE).shapes[0]
            queries(pyrt.RayTracer(mesh.vertices, mesh.triangles))

        def leak() -> None:
            kept.append(mmap(-1, MIB))
            kept[-1].write(b"x" * MIB)

        return {
            "pictures": growth(picture, times),
            "renderers": growth(lambda: pyrt.render(scene, spp=1), times),
            "queries": growth(lambda: queries(tracer), times),
            "scenes": growth(come_and_go, times),
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
    assert found["renderers"] < 8 + times * BUILD
    assert found["queries"] < 4
    assert found["scenes"] < 8
    assert found["leak"] > 15


MATERIALS = {"m": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}}
SMALL = {"film": {"resolution": [16, 16]}, "integrator": {"spp": 4}}
PEAK = """
import json, sys, pyrt
from pathlib import Path
from pyrt.memory import estimate, picture_bytes
scene = pyrt.load_scene(sys.argv[1])
pyrt.Renderer(scene).render().save(sys.argv[1] + ".png")
status = Path("/proc/self/status").read_text()
peak = 1024 * int(status.partition("VmHWM:")[2].split()[0])
need = estimate(scene, picture_bytes(scene, scene.film.width * scene.film.height, scene.spp))
print(json.dumps([peak, need.total]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell memory use")
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"film": {"resolution": [2048, 2048]}},
        {"film": {"resolution": [1024, 1024]}, "integrator": {"spp": 31}},
        {"integrator": {"spp": 100_000}},
        {"objects": [{"type": "icosphere", "subdivisions": 7, "material_name": "m"}]},
        {"objects": [{"type": "icosphere", "subdivisions": 8, "material_name": "m", "smooth": True}]},
        {
            "objects": [
                {"type": "sphere", "center": [i % 100, i // 100, 0], "radius": 0.3, "material_name": "m"}
                for i in range(100_000)
            ]
        },
    ],
    ids=("tiny", "4 M pixels", "1 M pixels, 31 spp", "1e5 spp", "327,680 triangles", "1.3 M smooth", "1e5 spheres"),
)
def test_estimates_are_within_a_fifth_of_the_peak(tmp_path, changes):
    """The second time, as compiling the kernels takes memory too."""
    ball = {"type": "icosphere", "subdivisions": 2, "material_name": "m"}
    file = tmp_path / "scene.json"
    file.write_text(json.dumps({**SMALL, "materials": MATERIALS, "objects": [ball], **changes}))
    command = [sys.executable, "-c", PEAK, str(file)]
    for _ in range(2):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    peak, estimate = json.loads(done.stdout)
    assert abs(estimate / peak - 1) < 0.2
