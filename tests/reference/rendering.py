"""Renders of pyrt as replicates over seeds, and their comparison with the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import pyrt
from pyrt.scene import Camera, ConstantTexture, Diffuse, Light, Material, Scene, Shape, Texture

from .analytic import Array
from .statistics import ROUNDING, Estimate, assert_agrees, gaussian, replicate, z_scores

ALBEDO = (0.5, 0.25, 0.75)
SEEDS = 16


def make_scene(
    *shapes: Shape,
    camera: Camera,
    lights: tuple[Light, ...] = (),
    materials: tuple[Material, ...] = (Diffuse(0),),
    textures: tuple[Texture, ...] = (ConstantTexture(ALBEDO),),
    max_depth: int = 16,
) -> Scene:
    """A scene whose material 0 is, unless told otherwise, diffuse with reflectance ALBEDO."""
    return Scene(
        camera=camera, textures=textures, materials=materials, shapes=shapes, lights=lights, max_depth=max_depth
    )


def replicates(scene: Scene, spp: int, size: tuple[int, int], seeds: int = SEEDS) -> Array:
    """(seeds, height, width, 3) independent renders; no sample may have been dropped."""
    renderer = pyrt.Renderer(scene)
    results = [renderer.render(spp=spp, seed=seed, size=size) for seed in range(seeds)]
    assert all((result.samples == spp).all() for result in results)
    return np.array([result.image for result in results], float)


def assert_renders(
    scene: Scene,
    truth: Array | Estimate,
    spp: int = 64,
    bias: float | None = None,
    rounding: float = ROUNDING,
    where: NDArray[np.bool_] | None = None,
) -> None:
    """Fail unless the renders' mean is the truth (height, width, 3) in every pixel (of `where`), and on average.

    The noise is what the replicates show of it, and the largest score has a chance of 1e-3 (Student, Bonferroni).
    `bias` bounds the mean relative error of the pixels that are not black, and the renders must be precise enough to
    find it.
    """
    full = truth if isinstance(truth, Estimate) else Estimate(truth, np.zeros_like(truth))
    height, width, _ = full.mean.shape
    where = np.ones((height, width), bool) if where is None else where
    images, known = replicates(scene, spp, (width, height))[:, where], Estimate(full.mean[where], full.variance[where])
    whole = Estimate(known.mean.mean(0), known.variance.mean(0) / len(known.mean))
    for samples, expected in ((images, known), (images.mean(1), whole)):
        assert_agrees(gaussian(z_scores(replicate(samples), expected, rounding), SEEDS - 1))
    if bias is not None:
        lit = known.mean > 0
        error = replicate((images[:, lit] / known.mean[lit] - 1).mean(1))
        assert np.sqrt(error.variance) < bias / 2
        assert abs(error.mean) < bias
