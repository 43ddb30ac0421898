"""Renders of pyrt as replicates over seeds, and their comparison with the truth."""

from __future__ import annotations

import numpy as np

import pyrt
from pyrt.scene import Camera, ConstantTexture, Diffuse, Material, PointLight, Scene, Shape, Texture

from .analytic import Array
from .statistics import ROUNDING, Estimate, assert_agrees, gaussian, replicate, z_scores

ALBEDO = (0.5, 0.25, 0.75)
SEEDS = 16


def make_scene(
    *shapes: Shape,
    camera: Camera,
    lights: tuple[PointLight, ...] = (),
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
    scene: Scene, truth: Array | Estimate, spp: int = 64, bias: float | None = None, rounding: float = ROUNDING
) -> None:
    """Fail unless the renders' mean is the truth (height, width, 3) in every pixel, and on average.

    The noise is what the replicates show of it, and the largest score has a chance of 1e-3 (Student, Bonferroni).
    An estimated truth must rest on about as many rays as the renders, or it misses what is small in a pixel.
    `bias` bounds the relative error of the whole image's mean, and the renders must be precise enough to find it.
    """
    known = truth if isinstance(truth, Estimate) else Estimate(truth, np.zeros_like(truth))
    images = replicates(scene, spp, (known.mean.shape[1], known.mean.shape[0]))
    whole = Estimate(known.mean.mean((0, 1)), known.variance.sum((0, 1)) / images[0, ..., 0].size ** 2)
    for samples, expected in ((images, known), (images.mean((1, 2)), whole)):
        assert_agrees(gaussian(z_scores(replicate(samples), expected, rounding), SEEDS - 1))
    if bias is not None:
        assert (known.mean > 0).all()
        error = replicate((images / known.mean - 1).mean((1, 2, 3)))
        assert np.sqrt(error.variance) < bias / 2
        assert abs(error.mean) < bias
