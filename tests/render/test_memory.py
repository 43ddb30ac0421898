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
from typing import Any

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
    assert found["scenes"] < 8 + times * BUILD  # each tracer builds a program
    assert found["leak"] > 15


MATERIALS = {"m": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}}
SMALL = {"film": {"resolution": [16, 16]}, "integrator": {"spp": 4}}
PEAK = """
import json, sys, pyrt
from pathlib import Path
from pyrt.memory import estimate
from pyrt.picture import required_bytes
from pyrt.request import request_for
scene, options = pyrt.load_scene("scene.json"), json.loads(sys.argv[1])
pyrt.Renderer(scene).render(**options).save("picture.exr" if "aovs" in options else "picture.png")
status = Path("/proc/self/status").read_text()
peak = 1024 * int(status.partition("VmHWM:")[2].split()[0])
need = estimate(scene, required_bytes(scene, request_for(scene, **options)))
print(json.dumps([peak, need.total]))
"""


def ball(subdivisions: int, **more: object) -> dict[str, Any]:
    return {"objects": [{"type": "icosphere", "subdivisions": subdivisions, "material_name": "m", **more}]}


def many(count: int, **kind: object) -> dict[str, Any]:
    places = ([i % 1000, i // 1000, 0] for i in range(count))
    own = "translate" if kind["type"] == "mesh" else "center"
    return {"objects": [{own: place, "material_name": "m", **kind} for place in places]}


def image(side: int) -> dict[str, Any]:
    texture = {"type": "image", "path": f"{side}.png"}
    return {"textures": {"t": texture}, "materials": {"m": {"type": "diffuse", "texture_name": "t"}}}


SPHERE = {"type": "sphere", "radius": 0.3}
RECTANGLE = {"type": "rectangle", "edge1": [0.5, 0, 0.1], "edge2": [0, 0.5, 0.1]}
SIDE = 2048
PEAKS: dict[str, tuple[Callable[[], dict[str, Any]], dict[str, object]]] = {
    "tiny": (dict, {}),
    "4 M pixels": (dict, {"size": [SIDE, SIDE]}),
    "1 M pixels, 31 spp": (dict, {"size": [1024, 1024], "spp": 31}),
    "8k": (dict, {"size": [7680, 4320]}),
    "1e5 spp": (dict, {"spp": 100_000}),
    "channels": (dict, {"size": [SIDE, SIDE], "aovs": ["z", "normal", "position", "albedo", "object"]}),
    "noise": (dict, {"size": [SIDE, SIDE], "noise": 0.05}),
    "checkpoint": (dict, {"size": [SIDE, SIDE], "spp": 8, "checkpoint": "checkpoint.exr"}),
    "checkpoint, 31 spp": (dict, {"size": [1024, 1024], "spp": 31, "checkpoint": "checkpoint.exr"}),
    "327,680 triangles": (lambda: ball(7), {}),
    "1.3 M smooth": (lambda: ball(8, smooth=True), {}),
    "5.2 M triangles": (lambda: ball(9, smooth=False), {}),
    "1e5 spheres": (lambda: many(100_000, **SPHERE), {}),
    "1e6 spheres": (lambda: many(10**6, **SPHERE), {}),
    "1e6 rectangles": (lambda: many(10**6, **RECTANGLE), {}),
    "1e6 meshes": (lambda: many(10**6, type="mesh", path="quad.obj"), {}),
    "4k texture": (lambda: image(4096), {}),
    "16k texture": (lambda: image(16384), {}),
}


def write_image_file(path: Path, side: int) -> None:
    """A PNG of so many pixels on a side, a few rows at a time."""
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(side, side, 3, "uint8")
    spec.attribute("png:compressionLevel", 1)
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), spec)
    rows = np.random.default_rng(0).random((64, side, 3), np.float32)
    for row in range(0, side, 64):
        file.write_scanlines(row, row + 64, 0, rows)
    file.close()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not tell memory use")
@pytest.mark.parametrize("name", PEAKS)
def test_estimates_are_within_a_fifth_of_the_peak(tmp_path, name):
    """The second time, as compiling the kernels takes memory too."""
    changes, options = PEAKS[name][0](), PEAKS[name][1]
    (tmp_path / "scene.json").write_text(json.dumps({**SMALL, "materials": MATERIALS, **ball(2), **changes}))
    (tmp_path / "quad.obj").write_text("v 0 0 0\nv .5 0 .1\nv .5 .5 .2\nv 0 .5 .1\nf 1 2 3 4\n")
    for texture in changes.get("textures", {}).values():
        write_image_file(tmp_path / texture["path"], int(Path(texture["path"]).stem))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", PEAK, json.dumps(options)]
    for _ in range(2):
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    peak, estimate = json.loads(done.stdout)
    assert abs(estimate / peak - 1) < 0.2
