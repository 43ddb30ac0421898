"""Small scenes whose picture is known: what each renderer makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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


def _ceiling(paint: Paint, quick: bool) -> float:
    """Share of a floor's pixels that change when a ceiling is put into the plane of the lamp, or one ulp below."""
    changed = []
    for above in (0.0, float(np.spacing(np.float32(1.0)))):
        floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(4, 0, 0), edge2=(0, 4, 0), material=0)
        lamp = Rectangle(
            name="lamp", center=(0.3, 0.2, 1 + above), edge1=(0.7, 0, 0), edge2=(0, -0.5, 0), radiance=RADIANCE
        )
        ceiling = Rectangle(name="ceiling", center=(0, 0, 1), edge1=(4, 0, 0), edge2=(0, -4, 0), material=0)
        camera = Camera((0, -0.5, 0.7), (0, 0, 0), (0, 1, 0), 60)
        scenes = (_scene(*shapes, camera=camera) for shapes in ((floor, lamp), (floor, lamp, ceiling)))
        without, with_ceiling = (paint(scene, (32, 32), 16, 1) for scene in scenes)
        changed.append((~(np.abs(with_ceiling / without - 1) <= 0.01)).any(axis=2).mean())
    return float(np.mean(changed))


def _box(paint: Paint, quick: bool) -> float:
    """Share of lit pixels inside a box without a bottom that stands on a floor, at three places, the lamp outside."""
    lit = []
    vertices, triangles = meshes.cube()
    sides = triangles[~(vertices[triangles][:, :, 2] == -1).all(axis=1)]
    for place in (0.0, 1e3, 1e5):
        shift = np.array([place, place, 0.0])
        box = Mesh(
            name="box", material=0, vertices=0.3 * vertices + (0, 0, 0.3) + shift, triangles=sides.astype(np.int32)
        )
        floor = Rectangle(name="floor", center=tuple(shift), edge1=(4, 0, 0), edge2=(0, 4, 0), material=0)
        bulb = PointLight(tuple(shift + (-2.0, 0.05, 0.01)), (10.0, 10.0, 10.0))
        camera = Camera(tuple(shift + (0.1, 0.0, 0.5)), tuple(shift + (-0.3, 0.02, 0.0)), (0, 0, 1), 90)
        lit.append((paint(_scene(box, floor, camera=camera, lights=(bulb,)), (64, 64), 64, 1) != 0).any(axis=2).mean())
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


LAMP = Rectangle(name="lamp", center=(0.2, 0.1, 2), edge1=(1, 0, 0), edge2=(0, -1, 0), radiance=RADIANCE)
HALF_PLANE = np.array([[(0, -50, 1.0), (50, -50, 1), (0, 50, 1)], [(50, -50, 1), (50, 50, 1), (0, 50, 1.0)]])


def _penumbra(paint: Paint, quick: bool) -> float:
    camera = Camera(CAMERA.position, CAMERA.look_at, CAMERA.up, 12)  # pixels much smaller than the penumbra
    plate = Mesh(
        name="plate", vertices=HALF_PLANE.reshape(-1, 3), triangles=np.arange(6, dtype=np.int32).reshape(-1, 3)
    )

    def irradiance(points: Array, normals: Array) -> Array:
        seen = analytic.visible_irradiance(points, normals, rectangle_corners(LAMP), HALF_PLANE)
        return np.asarray(seen[:, None] * RADIANCE)

    return _bias(paint, _scene(FLOOR, LAMP, plate, camera=camera), _floor_truth(irradiance, camera), quick)


def _form_factors(paint: Paint, quick: bool) -> float:
    """Proven error of the worse of the two, of unit squares: the picture shows just the receiving one."""
    worst, white = 0.0, (ConstantTexture((1.0, 1.0, 1.0)),)
    receiver = Rectangle(name="receiver", center=(0, 0, 0), edge1=(1, 0, 0), edge2=(0, 1, 0), material=0)
    camera = Camera((0, 0, 0.5), (0, 0, 0), (0, 1, 0), 90)
    lamps = {
        analytic.FORM_FACTOR_PARALLEL: ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
        analytic.FORM_FACTOR_PERPENDICULAR: ((0.5, 0, 0.5), (0, 0, 1), (0, 1, 0)),
    }
    for factor, (center, edge1, edge2) in lamps.items():
        lamp = Rectangle(name="lamp", center=center, edge1=edge1, edge2=edge2, radiance=(1.0, 1.0, 1.0))
        scene = replace(_scene(receiver, lamp, camera=camera), textures=white)
        means = np.array([paint(scene, (64, 64), 64 if quick else 1024, seed).mean() for seed in range(16)])
        worst = max(worst, float(abs(means.mean() - factor) - 3 * means.std(ddof=1) / np.sqrt(len(means))))
    return max(worst, 0.0)


CASES = (
    Case("N13", "closed rooms at 1e3, 1e5, 1e7: pixels off by 1 %", 0, _moved_rooms),
    Case("N13", "closed rooms of size 1e-6 … 1e6: pixels off by 1 %", 0, _scaled_rooms),
    Case("N14", "plate 1e-1 … 1e-5 under a lamp: lit pixels", 0, _plate),
    Case("N15", "ceiling in the plane of its lamp: pixels off by 1 %", 0, _ceiling),
    Case("N15", "inside a box on a floor, at 0, 1e3, 1e5: lit pixels", 0, _box),
    Case("N16", "point light: proven relative bias", 2e-6, _point_light),
    Case("N17", "lamps of 1 … 1e-9 sr: proven relative bias", 1e-5, _lamps),
    Case("N18", "penumbra of a half-plane: proven relative bias", 1e-4, _penumbra),
    Case("N19", "form factors of unit squares: proven error", 1e-5, _form_factors),
)
