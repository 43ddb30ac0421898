"""The same device gives the same bits, whatever the passes, tiles, work-groups, threads and the order of the faces."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import pyrt
from pyrt.device import list_devices
from pyrt.layout import kernel_dir
from pyrt.passes import SampleTracer
from pyrt.scene import Scene
from tests.controls import kernels
from tests.render.everything import SIZE, everything, shuffled

SPP = 24
SCENE = everything()
DEVICES = [device.index for device in list_devices() if device.kind == "cpu"]


def digest(renderer: pyrt.Renderer, seed: int = 0, **options: int) -> str:
    """Of every bit that a user sees."""
    result = renderer.render(SPP, seed, SIZE, **options)
    assert (result.samples == SPP).all()
    return hashlib.sha256(result.image.tobytes() + result.variance.tobytes()).hexdigest()


@pytest.fixture(scope="module", params=DEVICES)
def renderer(request: pytest.FixtureRequest) -> pyrt.Renderer:
    return pyrt.Renderer(SCENE, request.param)


@pytest.fixture(scope="module")
def expected(renderer: pyrt.Renderer) -> str:
    return digest(renderer)


def another(renderer: pyrt.Renderer, scene: Scene = SCENE) -> pyrt.Renderer:
    """A second one on the same device."""
    return pyrt.Renderer(scene, renderer._on_device.device.info.index)


@pytest.mark.parametrize("pass_samples", [13, 64, 1000, 1440])
def test_pass_size(expected, renderer, pass_samples):
    """Half the samples of one pixel at a time; some pixels at a time; and 16 passes of 60 pixels."""
    assert digest(renderer, pass_samples=pass_samples) == expected


def test_pass_size_of_adaptive_sampling(renderer):
    """Which pixels go on does not depend on the passes either."""
    once, often = (renderer.render(64, size=SIZE, noise=0.02, pass_samples=n) for n in (1 << 20, 100))
    assert len(np.unique(once.samples)) > 1
    np.testing.assert_array_equal(once.samples, often.samples)
    np.testing.assert_array_equal(once.image, often.image)


@pytest.mark.parametrize("local_size", [128, *(pytest.param(n, marks=pytest.mark.slow) for n in (8, 16, 32))])
def test_work_group_size(expected, renderer, local_size, monkeypatch):
    for module in ("device", "passes"):
        monkeypatch.setattr(f"pyrt.{module}.LOCAL_SIZE", local_size)
    assert digest(another(renderer)) == expected


@pytest.mark.parametrize("tile", [1, 7, 32])
def test_order_of_the_pixels(expected, renderer, tile, monkeypatch):
    monkeypatch.setattr("pyrt.passes._TILE", tile)
    assert digest(renderer) == expected


@pytest.mark.parametrize("seed", [1, 2])
def test_order_of_the_faces(expected, renderer, seed):
    """The trees differ, but not what rays hit; no ray of this picture meets two faces at the very same distance."""
    scene = shuffled(SCENE, seed)
    assert (scene.shapes[2].triangles != SCENE.shapes[2].triangles).any()
    assert digest(another(renderer, scene)) == expected


def merge_ranges(monkeypatch: pytest.MonkeyPatch, first: int) -> None:
    """Samples [0, first) and [first, n) traced apart, as if by two processes, and their films merged."""
    trace = SampleTracer.trace

    def trace_halves(tracer, pixels, first_sample, samples):
        head, _ = trace(tracer, pixels, first_sample, first)
        tail, _ = trace(tracer, pixels, first_sample + first, samples - first)
        return tail.merge(head), len(pixels)

    monkeypatch.setattr(SampleTracer, "trace", trace_halves)


@pytest.mark.parametrize("first", [1, 8, 12, 23])
def test_merged_sample_ranges(expected, renderer, first, monkeypatch):
    merge_ranges(monkeypatch, first)
    assert digest(renderer) == expected


@pytest.mark.parametrize("threads", ["1", "3"])
def test_number_of_threads(expected, renderer, threads):
    """In a process of its own; so a second process gives the same bits too."""
    info = renderer._on_device.device.info
    if not info.is_pocl:
        pytest.skip("how to limit the threads of this device is unknown")
    code = f"""from tests.render.test_determinism import SCENE, digest, pyrt
print(digest(pyrt.Renderer(SCENE, {info.index})))"""
    environment = {**os.environ, "POCL_MAX_PTHREAD_COUNT": threads, "PYTHONPATH": "."}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == expected


# Negative controls ----------------------------------------------------------------------------------------------------


def test_another_seed_gives_other_bits(expected, renderer):
    assert digest(renderer, seed=1) != expected


def renderer_with(old: str, new: str) -> pyrt.Renderer:
    """Of a small scene, with kernels that break the rule that a sample depends on nothing but its pixel and index."""
    text = (kernel_dir() / "render.cl").read_text(encoding="utf-8")
    assert text.count(old) == 1
    with kernels(files={"render.cl": text.replace(old, new)}):
        return pyrt.Renderer(pyrt.load_scene("example:cornell"))


def test_samples_that_depend_on_the_pass_are_noticed(monkeypatch):
    weak = renderer_with("pass->first_sample + s;", "s;")
    whole = digest(weak)
    assert digest(weak, pass_samples=13) != whole
    merge_ranges(monkeypatch, 12)
    assert digest(weak) != whole


@pytest.mark.slow
def test_samples_that_depend_on_their_order_are_noticed(monkeypatch):
    weak = renderer_with("hash_uint(pixel ^", "hash_uint((Uint)(g) ^")
    whole = digest(weak)
    monkeypatch.setattr("pyrt.passes._TILE", 7)
    assert digest(weak) != whole


@pytest.mark.slow
def test_samples_that_depend_on_their_work_group_are_noticed(monkeypatch):
    def weak() -> pyrt.Renderer:
        return renderer_with("hash_uint(pixel ^", "hash_uint((Uint)((uint)get_group_id(0)) ^")

    whole = digest(weak())
    for module in ("device", "passes"):
        monkeypatch.setattr(f"pyrt.{module}.LOCAL_SIZE", 128)
    assert digest(weak()) != whole


def test_an_order_of_faces_that_decides_ties_is_noticed(renderer):
    """Each face of a mesh twice, with its own normals and with others: the lower number is seen."""
    ball = SCENE.shapes[2]
    triangles = np.concatenate([ball.triangles, ball.triangles])
    normals = np.zeros((len(triangles), 3, 3), np.float32)
    normals[: len(ball.triangles)] = (0.0, 1.0, 0.0)
    normals[len(ball.triangles) :] = (0.6, 0.8, 0.0)
    twice = replace(ball, triangles=triangles, normals=normals, uvs=None)
    scene = replace(SCENE, shapes=(*SCENE.shapes[:2], twice, *SCENE.shapes[3:]))
    assert digest(another(renderer, scene)) != digest(another(renderer, shuffled(scene, 1)))
