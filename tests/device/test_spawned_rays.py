"""Rays that leave surfaces, and shadow segments: nothing hits itself, nothing leaks (N12 – N15)."""

from __future__ import annotations

import numpy as np
import pytest

import pyrt
from pyrt.procedural import icosphere
from pyrt.scene import Camera, Mesh, PointLight, Rectangle, Shape, Sphere
from tests import meshes
from tests.reference.rendering import make_scene
from tests.reference.tracer import camera_rays
from tests.stress import bounces, lit_under_plate, rays_at_random_triangles

EACH = pytest.mark.parametrize("each", [100, pytest.param(1000, marks=pytest.mark.slow)])


def test_no_ray_that_leaves_a_plane_hits_a_larger_triangle_in_it():
    random = np.random.default_rng(0)
    floor = np.array([(-1.0, 0.0, -1.0), (1.0, 0.0, -1.0), (0.0, 0.0, 1.0)])
    small = 0.005 * random.uniform(-1, 1, (200, 3, 3)) + 0.25 * random.uniform(-1, 1, (200, 1, 3))
    small[..., 1] = 0.0
    targets = meshes.points_on_triangles(random, np.repeat(small, 200, axis=0))
    directions = random.normal(size=targets.shape) * (0.3, 0.3, 0.3) - (0, 2, 0)
    for turn in (np.eye(3), np.linalg.qr(random.normal(size=(3, 3)))[0]):
        vertices, triangles = meshes.soup(np.concatenate([small, floor[None]]) @ turn)
        mesh = Mesh(name="plane", vertices=vertices, triangles=triangles, material=0)
        counts = bounces(mesh, (targets - directions) @ turn, directions @ turn, 1)
        assert counts.hits == counts.escaped == len(targets)


@EACH
@pytest.mark.parametrize("scale", [0.0, 2.0, 8.0])
@pytest.mark.parametrize("control", ["no id skip", "no offset"])
def test_no_ray_hits_the_triangle_that_it_leaves(scale, control, each):
    """The offset suffices without the id, and the id without the offset."""
    (vertices, triangles), origins, directions = rays_at_random_triangles(scale, each)
    mesh = Mesh(name="triangles", vertices=vertices, triangles=triangles, material=0)
    counts = bounces(mesh, origins, directions, 3, control, both_sides=True)
    assert counts.hits > 1.5 * len(origins)
    assert counts.again == 0


ROOMS = {"cube": meshes.cube(), "icosphere": icosphere(3)}
PLACES = [(0.0, 1.0), (0.0, 1e-6), (0.0, 1e6), (1e3, 1.0), (1e5, 1.0), (1e5, 1e-3), (1e7, 1.0), (1e7, 1e6)]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("room", [*ROOMS, "ball"])
@pytest.mark.parametrize("count", [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_no_path_leaves_a_closed_room(room, place, count):
    center, size = place
    if room == "ball":
        shape: Shape = Sphere(name=room, center=(center,) * 3, radius=size, material=0)
    else:
        vertices, triangles = ROOMS[room]
        shape = Mesh(name=room, vertices=center + size * vertices, triangles=triangles, material=0)
    random = np.random.default_rng(0)
    origins = center + size * meshes.points_inside(random, count, 0.9)
    counts = bounces(shape, origins, random.normal(size=(count, 3)), 20)
    assert counts.escaped == 0
    assert counts.again == 0
    assert counts.hits == 21 * count


def fine_room(name: str, times: int) -> tuple[Mesh, meshes.Floats]:
    """A room of many small triangles, askew, and points inside of it."""
    mesh = meshes.cube() if name == "cube" else meshes.lens(float(name), 12)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    vertices, triangles = meshes.subdivided(mesh, times)
    inside = 0.4 * meshes.points_inside(np.random.default_rng(1), 100_000, 1.0) * vertices.max(axis=0)
    return Mesh(name=name, vertices=vertices @ turn, triangles=triangles, material=0), inside @ turn


@pytest.mark.parametrize("name", ["cube", "10", pytest.param("60", marks=pytest.mark.slow)])
@pytest.mark.parametrize("times", [0, 5, pytest.param(8, marks=pytest.mark.slow)])
def test_no_path_leaves_a_room_of_small_triangles(name, times):
    """Whose heights are hundreds of times larger than the rounding of places, or more; walls meet at 90, 60, 10°."""
    room, origins = fine_room(name, times)
    assert bounces(room, origins, np.random.default_rng(2).normal(size=origins.shape), 20).escaped == 0


def test_without_the_margin_at_edges_paths_leave_a_room_of_small_triangles():
    room, origins = fine_room("cube", 5)
    directions = np.random.default_rng(2).normal(size=origins.shape)
    assert bounces(room, origins, directions, 20, "no edge margin").escaped > 20


@pytest.mark.parametrize("room", ROOMS)
def test_no_path_that_starts_at_an_edge_leaves_the_room(room):
    vertices, triangles = ROOMS[room]
    random = np.random.default_rng(1)
    targets = meshes.points_on_edges(random, ROOMS[room], random.random(50_000))
    targets[::2] = vertices[random.integers(0, len(vertices), 25_000)]
    origins = meshes.points_inside(random, 50_000, 0.9)
    shape = Mesh(name=room, vertices=vertices, triangles=triangles, material=0)
    assert bounces(shape, origins, targets - origins, 3).escaped == 0


@pytest.mark.parametrize("gap", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
def test_a_plate_just_before_a_lamp_darkens_the_floor(gap):
    assert lit_under_plate(gap) == 0


def test_the_floor_is_lit_if_the_plate_is_above_the_lamp():
    assert lit_under_plate(-0.1) == 32 * 32


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5])
def test_a_plate_just_before_a_point_light_darkens_the_floor(gap):
    floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(0, 0, 4), edge2=(4, 0, 0), material=0)
    plate = Rectangle(name="plate", center=(0, 1 - gap, 0), edge1=(0.5, 0, 0), edge2=(0, 0, 0.5), material=0)
    camera = Camera(position=(0, 0.6, 0.6), look_at=(0, 0, 0), fov=30)
    light = PointLight((0, 1, 0), (10.0, 10.0, 10.0))
    image = pyrt.Renderer(make_scene(floor, plate, camera=camera, lights=(light,))).render(spp=4, size=(32, 32)).image
    assert not image.any()


@pytest.mark.parametrize("above", [0.0, np.spacing(np.float32(1.0)), 1e-12])
@pytest.mark.parametrize("kind", ["rectangle", "mesh"])
def test_a_lamp_in_a_ceiling_lights_the_room_as_if_there_were_no_ceiling(above, kind):
    """Also one float32 ulp above it. The room is the same, so every bit of the picture is."""
    floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(0, 0, 4), edge2=(4, 0, 0), material=0)
    wall = Rectangle(name="wall", center=(0, 1, -2), edge1=(4, 0, 0), edge2=(0, 2, 0), material=0)
    lamp: Shape = Rectangle(
        name="lamp", center=(0.3, 1 + above, 0.2), edge1=(0.7, 0, 0), edge2=(0, 0, 0.5), radiance=(5.0, 5.0, 5.0)
    )
    if kind == "mesh":
        vertices, triangles = meshes.grid(np.linspace(-0.3, 0.4, 4), np.linspace(-0.5, 0.5, 3))
        turned = vertices[:, [0, 2, 1]] + (0, 1 + above, 0)
        lamp = Mesh(name="lamp", vertices=turned, triangles=triangles, radiance=(5.0, 5.0, 5.0))
    ceiling = Rectangle(name="ceiling", center=(0, 1, 0), edge1=(4, 0, 0), edge2=(0, 0, 4), material=0)
    camera = Camera(position=(0, 0.6, 2), look_at=(0, 0.3, 0), fov=40)
    scenes = [make_scene(*shapes, camera=camera) for shapes in ((floor, wall, lamp), (floor, wall, lamp, ceiling))]
    without, with_ceiling = (pyrt.Renderer(scene).render(spp=16, size=(32, 32)).image for scene in scenes)
    assert (without[20:] > 0).all()
    assert np.array_equal(with_ceiling[16:], without[16:])


def hits_box(origins: meshes.Floats, directions: meshes.Floats) -> meshes.Floats:
    """(k,): where rays enter the box |x|, |z| <= 0.3, 0 <= y <= 0.6; inf if they do not."""
    with np.errstate(divide="ignore"):
        planes = (np.array([(-0.3, 0.0, -0.3), (0.3, 0.6, 0.3)])[:, None] - origins) / directions
    near, far = planes.min(axis=0).max(axis=1), planes.max(axis=0).min(axis=1)
    return np.where((near <= far) & (near > 0), near, np.inf)


def dark_pixels(camera: Camera, size: int, light: tuple[float, float, float]) -> np.ndarray:
    """(size, size): whether all of a pixel shows the floor y = 0 in the box's shadow, or a side without light."""
    place = np.linspace(0, 1, 6)
    corner = np.arange(size)
    film = np.stack(np.meshgrid(corner, corner), axis=2)[:, :, None, None] + np.stack(np.meshgrid(place, place), axis=2)
    origins, directions = camera_rays(camera, (size, size), film.reshape(-1, 2))
    entry = hits_box(origins, directions)
    box_points = origins + np.where(np.isfinite(entry), entry, 0.0)[:, None] * directions
    lit_side = (box_points[:, 1] > 0.6 - 1e-9) | (box_points[:, 0] < -0.3 + 1e-9)
    floor_points = origins - origins[:, 1:2] / directions[:, 1:2] * directions
    in_shadow = hits_box(floor_points, np.array(light) - floor_points) < 1
    dark = np.where(np.isfinite(entry), ~lit_side, in_shadow & (directions[:, 1] < 0))
    return dark.reshape(size, size, -1).all(axis=2)


def test_no_light_leaks_under_a_box_that_stands_on_the_floor():
    size, place = 96, (-2.0, 1.5, 0.05)
    vertices, triangles = meshes.cube()
    box = Mesh(name="box", vertices=0.3 * vertices + (0, 0.3, 0), triangles=triangles, material=0)
    floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(0, 0, 4), edge2=(4, 0, 0), material=0)
    camera = Camera(position=(1.5, 1.1, 0.4), look_at=(0.4, 0.0, 0.0), fov=40)
    scene = make_scene(box, floor, camera=camera, lights=(PointLight(place, (10.0, 10.0, 10.0)),))
    image = pyrt.Renderer(scene).render(spp=16, size=(size, size)).image
    dark = dark_pixels(camera, size, place)
    assert dark.sum() > 1000
    assert not image[dark].any()
    assert (image[~dark].max(axis=1) > 0).mean() > 0.9
