"""Small scenes whose picture is known: what each renderer makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import peers_mitsuba
from pyrt.procedural import icosphere
from pyrt.scene import Camera, ConstantTexture, Diffuse, Mesh, PointLight, Rectangle, Scene, Shape
from tests.reference import analytic, tracer

Array = NDArray[np.float64]
Paint = Callable[[Scene, tuple[int, int], int, int], Array]  # (scene, size, spp, seed) -> (height, width, 3)

ALBEDO = (0.5, 0.25, 0.75)
SIZE = (8, 8)
REPLICATES = 16
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

    return {"pyrt": ours} | ({"Mitsuba": theirs} if peers_mitsuba.version() else {})


def _scene(*shapes: Shape, camera: Camera, lights: tuple[PointLight, ...] = ()) -> Scene:
    return Scene(camera=camera, textures=(ConstantTexture(ALBEDO),), materials=(Diffuse(0),), shapes=shapes, lights=lights)


# Closed rooms ---------------------------------------------------------------------------------------------------------


def _cube() -> tuple[Array, NDArray[np.int32]]:
    corners = np.stack(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij"), 3).reshape(-1, 3)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))], np.int32)


def _room(mesh: tuple[Array, NDArray[np.int32]], place: float, scale: float) -> Scene:
    """A closed room around a point light; light falls by scale², so flux grows by as much."""
    vertices, triangles = mesh
    shift = np.array([place, -place, place])
    walls = Mesh(name="walls", material=0, vertices=vertices * scale + shift, triangles=triangles)
    eye, aim = shift + np.array((-0.5, 0.1, 0.2)) * scale, shift + np.array((0.9, 0.3, -0.2)) * scale
    flux = tuple(10.0 * scale**2 for _ in range(3))
    return _scene(walls, camera=Camera(tuple(eye), tuple(aim), (0, 1, 0), 70), lights=(PointLight(tuple(shift), flux),))


def _rooms(paint: Paint, placements: list[tuple[float, float]]) -> float:
    """Share of the pixels that are more than 1 % off the same room of size 1 around the origin."""
    wrong = []
    for mesh in (_cube(), icosphere(3)):
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


def _bias(paint: Paint, scene: Scene, truth: Array, spp: int) -> float:
    """Relative error of the picture's mean, so far as 16 replicates prove it: less three of their standard errors."""
    errors = np.array([(paint(scene, SIZE, spp, seed) / truth - 1).mean() for seed in range(REPLICATES)])
    return max(0.0, abs(errors.mean()) - 3 * errors.std(ddof=1) / np.sqrt(REPLICATES))


FLOOR = Rectangle(name="floor", center=(0, 0, 0), edge1=(40, 0, 0), edge2=(0, 40, 0), material=0)
CAMERA = Camera((0, -0.5, 0.7), (0, 0, 0), (0, 0, 1), 60)


def _point_light(paint: Paint, quick: bool) -> float:
    bulb = PointLight((0.3, 0.4, 1.5), (5.0, 6.0, 7.0))
    truth = _floor_truth(lambda p, n: analytic.point_irradiance(p, n, bulb.position, bulb.flux), CAMERA)
    return _bias(paint, _scene(FLOOR, camera=CAMERA, lights=(bulb,)), truth, 256 if quick else 4096)


def _lamps(paint: Paint, quick: bool) -> float:
    """The worst over lamps of 1, 1e-3, 1e-6 and 1e-9 sr."""
    worst = 0.0
    for solid_angle in (1.0, 1e-3, 1e-6, 1e-9):
        half = float(np.sqrt(solid_angle))
        lamp = Rectangle(name="lamp", center=(0, 0, 2), edge1=(2 * half, 0, 0), edge2=(0, -2 * half, 0), radiance=(1.0, 2.0, 3.0))
        corners = np.array([(-half, half, 2), (half, half, 2), (half, -half, 2), (-half, -half, 2)])
        truth = _floor_truth(lambda p, n, c=corners: analytic.polygon_irradiance(p, n, c)[:, None] * (1.0, 2.0, 3.0), CAMERA)
        worst = max(worst, _bias(paint, _scene(FLOOR, lamp, camera=CAMERA), truth, 256 if quick else 4096))
    return worst


CASES = (
    Case("N13", "closed rooms at 1e3, 1e5, 1e7: pixels off by 1 %", 0, _moved_rooms),
    Case("N13", "closed rooms of size 1e-6 … 1e6: pixels off by 1 %", 0, _scaled_rooms),
    Case("N14", "plate 1e-1 … 1e-5 under a lamp: lit pixels", 0, _plate),
    Case("N16", "point light: proven relative bias", 2e-6, _point_light),
    Case("N17", "lamps of 1 … 1e-9 sr: proven relative bias", 1e-5, _lamps),
)
