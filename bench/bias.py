"""The bias floor: does the error of every shipped scene keep falling, against an independent float64 reference?

The reference (tests/reference) follows pyrt's own camera rays, so that where both are right their difference has none
of the noise of edges. With x_k, r_k the two pictures of the same k rays per pixel, x_k − r_k estimates pyrt's bias, and
R = X − (x_k − r_k), X a converged picture of another seed, is pyrt's picture corrected by the reference: without bias,
and the yardstick for the ladder. There are two R, from two halves of the rays, and the product of the distances from
both has none of their noise. Rays that were not the same after all would make the estimates noisy, not wrong.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench.report import Outcome, Table, number
from bench.scenes import shipped
from pyrt.scene import Scene
from tests.device.probe import evaluate
from tests.reference import tracer

Array = NDArray[np.float64]

SIZE = (32, 32)
LADDER = (1 << 6, 1 << 10, 1 << 14, 1 << 18)
QUICK_LADDER = (1 << 6, 1 << 10, 1 << 12)
LIMIT = 1e-5  # relative
# Rays per pixel that the reference follows, and shadow rays to a light that it has to sample: brute force is slow.
SCENES = {
    "cornell": (1024, 1),
    "cornell_refraction": (1024, 1),
    "cornell_textured": (1024, 1),
    "cornell_area_light": (256, 1),
    "cornell_two_lights": (256, 1),
    "mesh_room": (64, 4),
    "showcase": (4, 1),
}
QUICK_SCENES = {"cornell": (64, 1), "cornell_area_light": (16, 1)}
_JITTER = """Sampler s = {hash_uint(pixel[i] ^ hash_uint(0x51633e2du)), index[i]};
    vstore2(sample_2d(s, 0u), i, point);"""  # as in render.cl, for seed 0


@dataclass(frozen=True)
class Floor:
    """Relative to the picture's mean: its bias with its standard error, and the root mean squared error at each spp."""

    bias: float
    deviation: float
    pixel_bias: float  # mean squared bias of pixels, from two halves of the rays; may be negative by chance
    errors: dict[int, float]
    resolution: float  # what an error must exceed to be told from the noise of the reference

    @property
    def is_proven(self) -> bool:
        """Whether a bias above the limit is beyond doubt (three standard errors)."""
        return abs(self.bias) - 3 * self.deviation > LIMIT


def run(quick: bool) -> Outcome:
    ladder = QUICK_LADDER if quick else LADDER
    rows, figures, data = [], {}, {}
    for name, (rays, shadow_rays) in (QUICK_SCENES if quick else SCENES).items():
        print(f"bias: {name}", file=sys.stderr)
        floor = _floor(shipped(name), rays, shadow_rays, ladder)
        figures[f"{name}, |bias|"] = abs(floor.bias)
        data[name] = asdict(floor)
        errors = (_above(floor.errors[spp], floor.resolution) for spp in ladder)
        bias = f"{floor.bias:+.1e}" + (" *" if floor.is_proven else "")
        rows.append((name, str(rays), bias, f"{floor.deviation:.1e}", f"{floor.pixel_bias:+.1e}", *errors))
    columns = ("scene", "rays", "bias", "± standard error", "bias² of pixels", *(f"RMSE at {spp}" for spp in ladder))
    notes = (
        f"All relative to the mean of the picture, {SIZE[0]}×{SIZE[1]} pixels; bias: pyrt less a float64 reference "
        f"along the same camera rays, so many per pixel; an asterisk: surely above {LIMIT:g}.",
        "RMSE: against a converged picture of another seed, corrected by the reference; it should fall to the right.",
    )
    return Outcome((Table("Bias floor", columns, tuple(rows), notes),), figures, data)


def _above(value: float, resolution: float) -> str:
    return number(value, 2) if value > resolution else f"< {number(resolution, 2)}"


def _floor(scene: Scene, rays: int, shadow_rays: int, ladder: tuple[int, ...]) -> Floor:
    renderer = pyrt.Renderer(scene)
    mean = float(renderer.render(1024, 1, SIZE).image.mean())
    truth = _reference(scene, rays, shadow_rays)
    halves = np.stack([_along(renderer, half, rays) - truth[half] for half in (0, 1)]) / mean
    converged = np.asarray(renderer.render(ladder[-1], 2, SIZE).image, np.float64) / mean - halves
    errors = {}
    for spp in ladder:
        first, second = renderer.render(spp, 3, SIZE).image / mean - converged
        errors[spp] = float(np.sqrt(max((first * second).mean(), 0.0)))
    pixels = halves.mean(axis=(0, 3))
    deviation = float(pixels.std(ddof=1) / np.sqrt(pixels.size))
    squares = halves[0] * halves[1]
    resolution = float(np.sqrt(2 * squares.std() / np.sqrt(squares.size)))
    return Floor(float(pixels.mean()), deviation, float(squares.mean()), errors, resolution)


def _along(renderer: pyrt.Renderer, half: int, rays: int) -> Array:
    """pyrt's picture of the first or the second half of its samples 0 … rays − 1, for seed 0."""
    first = np.asarray(renderer.render(rays // 2, 0, SIZE).image, np.float64)
    if half == 0:
        return first
    return 2 * np.asarray(renderer.render(rays, 0, SIZE).image, np.float64) - first


def _reference(scene: Scene, rays: int, shadow_rays: int) -> Array:
    """(2, height, width, 3): the reference's picture of the same halves."""
    width, height = SIZE
    y, x, index = (axis.ravel() for axis in np.mgrid[0:height, 0:width, 0:rays].astype(np.uint32))
    found = evaluate(
        "sampling.h",
        _JITTER,
        len(index),
        {"point": (np.float32, 2)},
        pixel=(y << 16) | x,
        index=np.ascontiguousarray(index),
    )
    film = np.float32(np.stack([x, y], 1)) + found["point"]  # rounded as on the device
    origins, directions = tracer.camera_rays(scene.camera, SIZE, film.astype(np.float64))
    rng = np.random.default_rng(0)
    step, parts = 1 << 16, []
    for start in range(0, len(film), step):
        part = slice(start, start + step)
        parts.append(tracer.radiance(scene, origins[part], directions[part], round(shadow_rays**0.5), rng))
    values = np.concatenate(parts).reshape(height, width, 2, rays // 2, 3)
    return np.asarray(np.moveaxis(values.mean(axis=3), 2, 0))
