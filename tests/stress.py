"""Rows of the stress suite as counts of failures, shared by the tests and by the controls that must fail them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pyrt
from pyrt.device import Device
from pyrt.features import build_options, feature_table
from pyrt.pack import pack_scene
from pyrt.scene import Camera, Rectangle, Shape
from tests import meshes
from tests.controls import compiled_from, kernels
from tests.meshes import Floats, Mesh
from tests.reference.rendering import make_scene

BOUNCE = Path(__file__).parent / "device" / "bounce.cl"

TARGETS = {
    "vertices": lambda random, mesh, count: mesh[0][random.integers(0, len(mesh[0]), count)],
    "edge midpoints": lambda random, mesh, count: meshes.points_on_edges(random, mesh, np.full(count, 0.5)),
    "edge points": lambda random, mesh, count: meshes.points_on_edges(random, mesh, random.random(count)),
}


def inside_rays(mesh: Mesh, target: str, count: int, seed: int = 0) -> tuple[Floats, Floats]:
    """From points inside the unit sphere of `mesh` to its vertices or edges."""
    random = np.random.default_rng(seed)
    origins = meshes.points_inside(random, count, 0.98)
    return origins, TARGETS[target](random, mesh, count) - origins


def misses(tracer: pyrt.RayTracer, origins: Floats, directions: Floats) -> int:
    """Rays that hit nothing, by both kinds of query."""
    missed = tracer.closest(origins, directions).triangle < 0
    assert np.array_equal(missed, ~tracer.occluded(origins, directions))
    return int(missed.sum())


def graded(steps: int, exponent: float) -> Floats:
    """0, and ± powers of ten from 10^-exponent to 1: lines of a grid whose cells become ever thinner."""
    positive = 10.0 ** np.linspace(-exponent, 0, steps)
    return np.concatenate([-positive[::-1], [0.0], positive])


SHEETS = {
    "needles": meshes.grid(graded(30, 7), np.array([-1.0, 1.0])),
    "needles both ways": meshes.grid(graded(12, 7), graded(12, 7)),
    "ever smaller": meshes.funnel(10.0 ** -np.linspace(0, 12, 40), 12),
}


def sheet_rays(name: str, count: int) -> tuple[Floats, Floats]:
    """At uniform points of random triangles in the middle of a sheet."""
    random = np.random.default_rng(3)
    vertices, triangles = SHEETS[name]
    corners = vertices[triangles]
    corners = corners[np.abs(corners.mean(axis=1)).max(axis=1) < 0.5]
    targets = meshes.points_on_triangles(random, corners[random.integers(0, len(corners), count)])
    if name == "ever smaller":  # has a hole of radius 1e-12 in its middle
        targets = targets[np.linalg.norm(targets, axis=1) > 1e-6]
    away = random.normal(size=targets.shape)
    away[:, 2] += np.copysign(1.0, away[:, 2])
    return targets + 10.0 ** random.uniform(-3, 0.5, (len(targets), 1)) * away, -away


def in_plane_rays(seed: int) -> tuple[Mesh, Floats, Floats]:
    """Triangles in one tilted plane, and rays that run in it."""
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.normal(size=(3, 3)))[0][:2]
    corners = random.uniform(-0.9, 0.9, (50, 1, 2)) + 0.1 * random.uniform(-1, 1, (50, 3, 2))
    origins, directions = random.uniform(-1, 1, (2, 20_000, 2)) @ basis
    return meshes.soup(corners @ basis), origins, directions


def disagreements(truth: Path, mesh: Mesh, origins: Floats, directions: Floats, t_max: float | Floats = np.inf) -> int:
    """Rays for which the current kernels and those in the folder `truth` do not find the same bits."""
    tracer = pyrt.RayTracer(*mesh)
    with compiled_from(truth):
        other = pyrt.RayTracer(*mesh)
    mine, known = (t.closest(origins, directions, t_max) for t in (tracer, other))
    same = tracer.occluded(origins, directions, t_max) == (known.triangle >= 0)
    for name in ("t", "triangle", "u", "v"):
        same &= getattr(mine, name) == getattr(known, name)
    return int((~same).sum())


@dataclass(frozen=True)
class Bounces:
    hits: int
    again: int  # hits on the triangle that the path had just left
    escaped: int  # paths that found nothing to hit


def bounces(
    shape: Shape, origins: Floats, directions: Floats, steps: int, *controls: str, both_sides: bool = False
) -> Bounces:
    """Paths that bounce up to `steps` times, staying on their side of surfaces or, with `both_sides`, changing it."""
    scene = make_scene(shape, camera=Camera())
    packed = pack_scene(scene)
    device = Device()
    with kernels(*controls, files={"bounce.cl": BOUNCE.read_text(encoding="utf-8")}):
        kernel = device.build("bounce.cl", build_options(feature_table(scene)))["bounce"]
    names = ("nodes", "triangle_blocks", "sphere_blocks", "triangles", "corners", "spheres")
    rays = np.concatenate([packed.space.apply(origins).T, directions.T]).astype(np.float32)
    arrays = {"params": packed.params, **{name: packed.arrays[name] for name in names}, "rays": rays}
    count = len(origins)
    out = device.allocate(12 * count)
    buffers = [device.upload(name, array) for name, array in arrays.items()]
    device.run(kernel, count, np.uint32(count), np.int32(steps), np.int32(both_sides), *buffers, out)
    with device.mapped(out, (3, count), np.int32) as array:
        return Bounces(*(int(n) for n in array.sum(axis=1)))


def rays_at_random_triangles(scale: float, each: int) -> tuple[Mesh, Floats, Floats]:
    """1000 triangles of sizes and places 10^-scale … 1, and `each` rays at either side of every one."""
    random = np.random.default_rng(0)
    place, size = 10.0 ** random.uniform(-scale, 0, (2, 1000, 1, 1))
    corners = place * random.uniform(-1, 1, (1000, 1, 3)) + size * random.uniform(-1, 1, (1000, 3, 3))
    targets = np.repeat(corners, each, axis=0)
    edges = targets[:, 1:] - targets[:, :1]
    normal = np.cross(edges[:, 0], edges[:, 1])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    directions = normal * random.choice([-1, 1], (len(normal), 1)) + random.uniform(-0.3, 0.3, normal.shape)
    origins = meshes.points_on_triangles(random, targets) - directions * np.abs(edges).max(axis=(1, 2))[:, None]
    return meshes.soup(corners), origins, directions


def lit_under_plate(gap: float) -> int:
    """Pixels of a floor that see a lamp at distance 1 through an opaque plate, `gap` before the lamp."""
    floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(0, 0, 4), edge2=(4, 0, 0), material=0)
    lamp = Rectangle(name="lamp", center=(0, 1, 0), edge1=(0.2, 0, 0), edge2=(0, 0, 0.2), radiance=(5.0, 5.0, 5.0))
    plate = Rectangle(name="plate", center=(0, 1 - gap, 0), edge1=(0.6, 0, 0), edge2=(0, 0, 0.6), material=0)
    camera = Camera(position=(0, 0.6, 0.6), look_at=(0, 0, 0), fov=30)
    image = pyrt.Renderer(make_scene(floor, lamp, plate, camera=camera)).render(spp=16, size=(32, 32)).image
    return int((image != 0).any(axis=2).sum())
