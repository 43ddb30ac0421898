"""The bias floor: does the error of every shipped scene keep falling, against an independent float64 reference?

Both renderers look at the same points of the picture, one in each cell of a grid: pyrt through a camera that is turned
to the point and sees next to nothing else. So the noise of edges is left out, and what remains is pyrt's sampling of
lights, which falls with the samples, and its bias, which does not. The reference (tests/reference) is exact where only
few triangles can hide polygon lights. Where it has to sample, there are two of it, and products of the differences from
both are free of their noise.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench.report import Outcome, Table, number
from bench.scenes import shipped
from pyrt.scene import Camera, Scene
from tests.reference import tracer

Array = NDArray[np.float64]

SIDE = 32  # cells of the grid along a side
QUICK_SIDE = 8
LADDER = (1 << 6, 1 << 10, 1 << 14, 1 << 18)
QUICK_LADDER = LADDER[:-1]
LIMIT = 1e-5  # relative
FOV = 1e-5  # degrees: a pixel as wide as the rounding of a direction
# Shadow rays, along a side of the light, of each reference that has to sample: brute force is slow.
SCENES = {
    "cornell": 1,
    "cornell_refraction": 1,
    "cornell_textured": 1,
    "cornell_area_light": 1,
    "cornell_two_lights": 1,
    "mesh_room": 16,
    "showcase": 1,
}
QUICK_SCENES = {name: SCENES[name] for name in ("cornell", "cornell_area_light")}


@dataclass(frozen=True)
class Floor:
    """Relative to the picture's mean: bias at the most samples with its standard error, and errors by samples."""

    bias: float
    deviation: float
    errors: dict[int, float]  # root mean square over the points
    resolution: float  # what an error must exceed to be told from the noise of the reference

    @property
    def is_proven(self) -> bool:
        """Whether a bias above the limit is beyond doubt (three standard errors)."""
        return abs(self.bias) - 3 * self.deviation > LIMIT


def run(quick: bool) -> Outcome:
    """The floor of every shipped scene."""
    side, ladder = (QUICK_SIDE, QUICK_LADDER) if quick else (SIDE, LADDER)
    rows, figures, data = [], {}, {}
    for name, subdivision in (QUICK_SCENES if quick else SCENES).items():
        print(f"bias: {name}", file=sys.stderr)
        floor = _floor(shipped(name), side, ladder, subdivision)
        figures[f"{name}, |bias|"] = abs(floor.bias)
        data[name] = asdict(floor)
        bias = f"{floor.bias:+.1e}" + (" *" if floor.is_proven else "")
        errors = (_above(floor.errors[spp], floor.resolution) for spp in ladder)
        rows.append((name, bias, f"{floor.deviation:.1e}", *errors))
    columns = ("scene", f"bias at {ladder[-1]}", "± standard error", *(f"RMSE at {spp}" for spp in ladder))
    notes = (
        f"Against a float64 reference at {side}×{side} points of the picture, relative to its mean. RMSE should fall "
        f"to {LIMIT:g}. An asterisk: bias surely above that; <: not to be told from the reference's own noise.",
    )
    return Outcome((Table("Bias floor", columns, tuple(rows), notes),), figures, data)


def _above(value: float, resolution: float) -> str:
    return number(value, 2) if value > resolution else f"< {number(resolution, 2)}"


def _floor(scene: Scene, side: int, ladder: tuple[int, ...], subdivision: int) -> Floor:
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), 2).reshape(-1, 2)
    film = cells + np.random.default_rng(0).random(cells.shape)
    origins, directions = tracer.camera_rays(scene.camera, (side, side), film)
    random = np.random.default_rng(1)
    truths = np.stack([tracer.radiance(scene, origins, directions, subdivision, random) for _ in range(2)])
    renderer, mean = pyrt.Renderer(scene), truths.mean()
    errors = {}
    for spp in ladder:
        differences = (_look(renderer, directions, spp) - truths) / mean
        errors[spp] = float(np.sqrt(max((differences[0] * differences[1]).mean(), 0.0)))
    points = differences.mean(axis=(0, 2))
    noise = ((truths[0] - truths[1]) / mean) ** 2 / 4
    resolution = float(np.sqrt(2 * noise.std() / np.sqrt(noise.size)))
    return Floor(float(points.mean()), float(points.std(ddof=1) / np.sqrt(points.size)), errors, resolution)


def _look(renderer: pyrt.Renderer, directions: Array, spp: int) -> Array:
    """(k, 3) radiance that pyrt sees along directions (k, 3) from its scene's camera."""
    scene = renderer.scene
    values = []
    for seed, direction in enumerate(directions):
        camera = _towards(scene.camera, direction)
        renderer.scene = replace(scene, camera=camera)  # the tree and the lights stay, cameras are read for each render
        values.append(renderer.render(spp, seed, (1, 1)).image[0, 0])
    renderer.scene = scene
    return np.array(values, np.float64)


def _towards(camera: Camera, direction: Array) -> Camera:
    x, y, z = (np.asarray(camera.position) + direction).tolist()
    return replace(camera, look_at=(x, y, z), fov=FOV)
