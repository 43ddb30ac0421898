"""Camera rays against float64, from inside the scene to a million extents away."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pyrt.pack import pack_camera, pack_scene
from pyrt.scene import Camera, Rectangle, Scene
from tests.device.probe import evaluate
from tests.reference.analytic import Array, dot, unit
from tests.reference.tracer import camera_rays

SIZE = (640, 360)
ULP = 2.0**-24
ROOM = Scene(shapes=(Rectangle(name="room", center=(3, -1, 2), edge1=(8, 0, 0), edge2=(0, 6, 1)),))


def film_points() -> Array:
    edges = [(0, 0), (640, 0), (0, 360), (640, 360), (320, 180)]
    return np.concatenate([edges, np.random.default_rng(0).uniform((0, 0), SIZE, (5000, 2))]).astype(np.float32)


def device_rays(camera: Camera, film: Array) -> tuple[Array, Array]:
    """Origins and directions (n, 3) in the normalised space of ROOM."""
    code = """
        float3 o, d;
        camera_ray(camera, film[2u * i], film[2u * i + 1u], &o, &d);
        vstore3(o, i, origin);
        vstore3(d, i, direction);
    """
    inputs = {"camera": pack_camera(pack_scene(ROOM), camera, *SIZE).reshape(1), "film": film}
    out = evaluate("camera.h", code, len(film), {"origin": (np.float32, 3), "direction": (np.float32, 3)}, **inputs)
    return out["origin"].astype(float), out["direction"].astype(float)


def true_rays(camera: Camera, film: Array) -> tuple[Array, Array]:
    space = pack_scene(ROOM).space
    origins, directions = camera_rays(camera, SIZE, film.astype(float))
    return space.apply(origins), directions


def looking_from(distance: float) -> Camera:
    """A camera that sees all of the room, whose half-diagonal is 5, from the given distance."""
    away = unit(np.array([0.3, 0.4, 1.0])) * distance
    fov = 2 * math.degrees(math.atan(5 / max(distance, 5)))
    return Camera(tuple(np.array([3, -1, 2]) + away), (3.1, -1, 2), (0, 1, 0), fov)


@pytest.mark.parametrize("distance", [1e-3, 1, 10, 1e3, 1e6, 5e6])
def test_rays_pass_the_scene_where_float64_says(distance):
    """The distance between both lines, at places within the scene: a few roundings of coordinates up to 1."""
    camera, film = looking_from(distance), film_points()
    origins, directions = device_rays(camera, film)
    true_origins, true_directions = true_rays(camera, film)
    for depth in (0.0, 0.5, 1.0, 2.0):
        points = origins + depth * unit(directions)
        offset = points - true_origins
        aside = offset - dot(offset, true_directions)[:, None] * true_directions
        assert np.linalg.norm(aside, axis=1).max() < 8 * ULP * (1 + depth)


@pytest.mark.parametrize("distance", [1e-3, 1, 10, 1e3, 1e6, 5e6])
def test_rays_start_before_the_scene(distance):
    """Nothing of the scene is behind the origin, and the origin is near enough for float32."""
    camera, film = looking_from(distance), film_points()
    packed = pack_scene(ROOM)
    origins, _ = device_rays(camera, film)
    assert np.abs(origins).max() < 8
    if distance >= 10:
        corners = packed.bound * np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
        forward = unit(np.subtract(camera.look_at, camera.position))
        assert (origins @ forward).max() < (corners @ forward).min()
    else:
        assert np.abs(origins - packed.space.apply(np.array(camera.position))).max() <= ULP


def test_float32_alone_would_lose_the_scene():
    """From a million extents away, float32 cannot even tell where the camera stands."""
    position = np.array(looking_from(5e6).position)
    assert np.abs(position.astype(np.float32) - position).max() > 0.01


def test_the_centre_of_the_film_looks_at_the_target():
    _, directions = device_rays(looking_from(10), np.array([(320, 180)], np.float32))
    camera = looking_from(10)
    forward = unit(np.subtract(camera.look_at, camera.position))
    assert np.abs(unit(directions[0]) - forward).max() < 2 * ULP
