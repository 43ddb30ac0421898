"""Small scenes whose picture is known: what each renderer makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import peers_mitsuba
from pyrt.geometry import rectangle_corners
from pyrt.procedural import icosphere
from pyrt.scene import Camera, ConstantTexture, Diffuse, Mesh, PointLight, Rectangle, Scene, Shape
from tests import meshes
from tests.reference import analytic, tracer

Array = NDArray[np.float64]
Paint = Callable[[Scene, tuple[int, int], int, int], Array]  # (scene, size, spp, seed) -> (height, width, 3)

ALBEDO = (0.5, 0.25, 0.75)
RADIANCE = (1.0, 2.0, 3.0)
SIZE = (8, 8)
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Case:
    """One row: `measure` takes a renderer, and whether to hurry."""

    name: str
    measures: str
    threshold: float
    measure: Callable[[Paint, bool], float]


def painters() -> dict[str, Paint]:
    """pyrt, and Mitsuba where it is installed."""

    def ours(scene: Scene, size: tuple[int, int], spp: int, seed: int) -> Array:
        return np.asarray(pyrt.Renderer(scene).render(spp, seed, size).image, np.float64)

    def theirs(scene: Scene, size: tuple[int, int], spp: int, seed: int) -> Array:
        return np.asarray(peers_mitsuba.renderer(scene, size)("multijitter", spp, seed), np.float64)

    found: dict[str, Paint] = {"pyrt": ours}
    return found | ({"Mitsuba": theirs} if peers_mitsuba.version() else {})


def _scene(*shapes: Shape, camera: Camera, lights: tuple[PointLight, ...] = ()) -> Scene:
    textures, materials = (ConstantTexture(ALBEDO),), (Diffuse(0),)
    return Scene(camera=camera, textures=textures, materials=materials, shapes=shapes, lights=lights)


# Closed rooms ---------------------------------------------------------------------------------------------------------


def _room(mesh: tuple[Array, NDArray[Any]], place: float, scale: float) -> Scene:
    """A closed room around a point light; light falls by scale², so flux grows by as much."""
    vertices, triangles = mesh
    shift = np.array([place, -place, place])
    walls = Mesh(name="walls", material=0, vertices=vertices * scale + shift, triangles=triangles.astype(np.int32))
    eye, aim = shift + np.array((-0.5, 0.1, 0.2)) * scale, shift + np.array((0.9, 0.3, -0.2)) * scale
    flux = 10.0 * scale**2
    return _scene(
        walls,
        camera=Camera(tuple(eye), tuple(aim), (0, 1, 0), 70),
        lights=(PointLight(tuple(shift), (flux, flux, flux)),),
    )


def _rooms(paint: Paint, placements: list[tuple[float, float]]) -> float:
    """Share of the pixels that are more than 1 % off the same room of size 1 around the origin."""
    wrong = []
    for mesh in (meshes.cube(), icosphere(3)):
        expected = paint(_room(mesh, 0.0, 1.0), (32, 32), 64, 1)
        for place, scale in placements:
            image = paint(_room(mesh, place, scale), (32, 32), 64, 1)
            wrong.append((~(np.abs(image / expected - 1) <= 0.01)).any(axis=2).mean())
    return float(np.mean(wrong))


def _moved_rooms(paint: Paint, quick: bool) -> float:
    return _rooms(paint, [(place, 1.0) for place in (1e3, 1e5, 1e7)])


def _scaled_rooms(paint: Paint, quick: bool) -> float:
    return _rooms(paint, [(0.0, 10.0**j) for j in (-6, -4, -2, 2, 4, 6)])


# Shadows --------------------------------------------------------------------------------------------------------------


def _plate(paint: Paint, quick: bool) -> float:
    """Lit share of the pixels of a floor 10 below a lamp, all of it hidden by a plate close below the lamp."""
    lit = []
    for gap in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5):
        floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(8, 0, 0), edge2=(0, 8, 0), material=0)
        lamp = Rectangle(name="lamp", center=(0, 0, 10), edge1=(1, 0, 0), edge2=(0, -1, 0), radiance=(100.0,) * 3)
        plate = Rectangle(name="plate", center=(0, 0, 10 - 10 * gap), edge1=(3, 0, 0), edge2=(0, 3, 0), material=0)
        camera = Camera((0, -0.5, 5), (0, 0, 0), (0, 1, 0), 60)
        image = paint(_scene(floor, plate, lamp, camera=camera), (32, 32), 64, 1)
        lit.append((image != 0).any(axis=2).mean())
    return float(np.mean(lit))


# Closed forms ---------------------------------------------------------------------------------------------------------


def _floor_truth(irradiance: Callable[[Array, Array], Array], camera: Camera) -> Array:
    def radiance(origins: Array, directions: Array) -> Array:
        points = origins + directions * (-origins[:, 2:] / directions[:, 2:])
        return np.asarray(np.array(ALBEDO) / np.pi * irradiance(points, np.broadcast_to(UP, points.shape)))

    return tracer.pixel_average(camera, SIZE, radiance, 8)


def _bias(paint: Paint, scene: Scene, truth: Array, quick: bool) -> float:
    """Relative error of the picture's mean, so far as replicates prove it: less three of their standard errors."""
    spp, seeds = (256, range(4)) if quick else (4096, range(16))
    errors = np.array([(paint(scene, SIZE, spp, seed) / truth - 1).mean() for seed in seeds])
    return max(0.0, float(abs(errors.mean()) - 3 * errors.std(ddof=1) / np.sqrt(len(errors))))


FLOOR = Rectangle(name="floor", center=(0, 0, 0), edge1=(40, 0, 0), edge2=(0, 40, 0), material=0)
CAMERA = Camera((0, -0.5, 0.7), (0, 0, 0), (0, 0, 1), 60)


def _point_light(paint: Paint, quick: bool) -> float:
    bulb = PointLight((0.3, 0.4, 1.5), (5.0, 6.0, 7.0))
    truth = _floor_truth(lambda p, n: analytic.point_irradiance(p, n, bulb.position, bulb.flux), CAMERA)
    return _bias(paint, _scene(FLOOR, camera=CAMERA, lights=(bulb,)), truth, quick)


def _lit(lamp: Array, points: Array, normals: Array) -> Array:
    return np.asarray(analytic.polygon_irradiance(points, normals, lamp)[:, None] * RADIANCE)


def _lamps(paint: Paint, quick: bool) -> float:
    """The worst over lamps of 1, 1e-3, 1e-6 and 1e-9 sr."""
    worst = 0.0
    for solid_angle in (1.0, 1e-3, 1e-6, 1e-9):
        half = float(np.sqrt(solid_angle))
        edges = (2 * half, 0, 0), (0, -2 * half, 0)
        lamp = Rectangle(name="lamp", center=(0, 0, 2), edge1=edges[0], edge2=edges[1], radiance=RADIANCE)
        truth = _floor_truth(partial(_lit, rectangle_corners(lamp)), CAMERA)
        worst = max(worst, _bias(paint, _scene(FLOOR, lamp, camera=CAMERA), truth, quick))
    return worst


CASES = (
    Case("N13", "closed rooms at 1e3, 1e5, 1e7: pixels off by 1 %", 0, _moved_rooms),
    Case("N13", "closed rooms of size 1e-6 … 1e6: pixels off by 1 %", 0, _scaled_rooms),
    Case("N14", "plate 1e-1 … 1e-5 under a lamp: lit pixels", 0, _plate),
    Case("N16", "point light: proven relative bias", 2e-6, _point_light),
    Case("N17", "lamps of 1 … 1e-9 sr: proven relative bias", 1e-5, _lamps),
)
