"""What random scenes (test_fuzz_render) have found, each with the least scene that shows it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyrt
from pyrt.cli import main
from pyrt.device import Device
from tests.controls import kernels

Json = dict[str, Any]
MIB = 2**20
WHITE = {"white": {"type": "diffuse", "color": [1, 1, 1]}}
FLOAT_MAX = np.finfo(np.float32).max


def render(scene: Json, folder: Path = Path(), **options: bool) -> pyrt.Result:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pyrt.Renderer(pyrt.load_scene(scene, base_dir=folder), **options).render()


def rectangle(center: Any, normal: Any, size: float, **fields: Any) -> Json:
    """A square whose front faces along `normal`."""
    normal = np.asarray(normal, float) / np.linalg.norm(normal)
    edge1 = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    edge1 *= size / np.linalg.norm(edge1)
    return {"type": "rectangle", "center": center, "edge1": edge1, "edge2": np.cross(normal, edge1), **fields}


def floor(size: float = 4.0, **fields: Any) -> Json:
    return rectangle([0, 0, 0], [0, 0, 1], size, material_name="white", **fields)


def seen_from_above(height: float, **sections: Any) -> Json:
    camera = {"position": [0, 0, height], "look_at": [0, 0, 0], "fov": 1e-3}
    film = {"resolution": [4, 4]}
    return {"integrator": {"spp": 16}, "film": film, "camera": camera, "materials": WHITE, **sections}


# Light ----------------------------------------------------------------------------------------------------------------


def test_a_mesh_light_of_one_triangle(tmp_path):
    """Its share of the light, 2^32 of 2^32, was 0: every sample was infinite, and dropped."""
    (tmp_path / "lamp.obj").write_text("v 0 0.02 2\nv 0.02 0 2\nv 0 0 2\nf 1 2 3\n")
    lamp = {"type": "mesh", "path": "lamp.obj", "light": {"radiance": [1, 2, 3]}}
    result = render(seen_from_above(1, objects=[floor(), lamp]), tmp_path)
    assert result.stats["dropped"]["samples"] == 0
    expected = 2e-4 / 4 / np.pi * np.array([1, 2, 3])  # area / distance^2, as if all of it were at the nearest point
    np.testing.assert_allclose(result.image, np.broadcast_to(expected, result.image.shape), rtol=3e-4)


@pytest.mark.parametrize("size", [1e-8, 1.0, 1e8])
def test_a_point_light_so_far_that_the_square_of_its_distance_overflows(size):
    distance = 1e14
    sun = {"position": [0, 0, distance], "flux": [4 * np.pi * distance**2] * 3}
    result = render(seen_from_above(size, lights=[sun], objects=[floor(size)]))
    np.testing.assert_allclose(result.image, 1 / np.pi, rtol=1e-6)


def bright_floor() -> Json:
    """Its irradiance, 1e39, is beyond float32."""
    return seen_from_above(1e-20, lights=[{"position": [0, 0, 1e-21], "flux": [0, 1, 1e30]}], objects=[floor(1e-20)])


def test_radiance_beyond_float32_is_the_largest_float():
    result = render(bright_floor())
    assert result.stats["dropped"]["samples"] == 0
    assert (result.image[..., 0] == 0).all()
    assert (result.image[..., 1:] > 1e37).all()
    assert np.isfinite(result.image).all()


def test_without_its_protection_such_radiance_is_dropped():
    with kernels("overflow"):
        assert render(bright_floor()).stats["dropped"]["samples"] == 4 * 4 * 16


def test_the_variance_of_bright_samples_is_finite():
    lamp = rectangle([0, 0, 0], [0, 0, 1], 1e-5, light={"radiance": [1e30, 1, 0]})
    result = render(seen_from_above(1, objects=[lamp], materials={}))
    assert ((result.image[..., 0] > 0) & (result.image[..., 0] < 0.9e30)).any()
    assert result.variance[..., 0].max() == FLOAT_MAX
    assert np.isfinite(result.variance).all()


# Glass ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("material", "towards"),
    [
        ({"type": "refraction", "eta": 1e30}, (0, 1, 0)),  # reflected
        ({"type": "refraction", "eta": 5e-324}, (0, -1, -1)),  # bent to the normal
        ({"type": "dielectric", "int_ior": 1e30, "ext_ior": 1e-30}, (0, 1, 0)),
        ({"type": "dielectric", "int_ior": 5e-324, "ext_ior": 1e30}, (0, 1, 0)),
    ],
)
def test_indices_of_refraction_whose_squares_overflow(material, towards):
    plate = rectangle([0, 0, 0], [0, 1, 1], 1, material_name="plate")
    lamp = rectangle(np.multiply(5, towards), np.negative(towards), 1, light={"radiance": [1, 1, 1]})
    result = render(seen_from_above(1, objects=[plate, lamp], materials={"plate": material}))
    np.testing.assert_allclose(result.image, 1, rtol=1e-6)


def ring(depth: int) -> Json:
    """Four mirrors lead a ray round and round, through plates that radiance grows in each time."""
    mirrors = [(1, -1, -1, 1), (1, 1, -1, -1), (-1, 1, 1, -1), (-1, -1, 1, 1)]
    plates = [(0.1, -1, -1, 0), (1, 0.1, 0, -1), (-0.1, 1, 1, 0), (-1, -0.1, 0, 1)]
    objects = [rectangle([x, y, 0], [nx, ny, 0], 0.9, material_name="mirror") for x, y, nx, ny in mirrors]
    objects += [rectangle([x, y, 0], [nx, ny, 0], 0.9, material_name="plate") for x, y, nx, ny in plates]
    return {
        "integrator": {"spp": 1, "max_depth": depth},
        "film": {"resolution": [1, 1]},
        "camera": {"position": [-0.5, -1, 0], "look_at": [0, -1, 0], "fov": 1e-9},
        "materials": {
            "mirror": {"type": "refraction", "eta": 1e9},
            "plate": {"type": "dielectric", "int_ior": 0.3, "ext_ior": 1},
        },
        "objects": objects,
    }


def test_paths_do_not_breed():
    """A sample traced 37 million rays at depth 256."""
    assert 256 < render(ring(256)).stats["rays"]["specular"] <= 64 * 256
    with kernels("splits without number"):
        assert render(ring(64)).stats["rays"]["specular"] > 100 * 64 * 64


# Cameras --------------------------------------------------------------------------------------------------------------


def wide(size: tuple[int, int], camera: Json, objects: list[Json]) -> Json:
    integrator = {"spp": 64, "point_light_position": [0, 0, 0]}
    film = {"resolution": size}
    return {"integrator": integrator, "film": film, "camera": camera, "materials": WHITE, "objects": objects}


# The corners of a small picture's only beam may be more than a right angle apart.
BALL = {"type": "icosphere", "subdivisions": 0}
WIDE = {
    "beams that start on their axis": wide(
        (4, 1),
        {"position": [-0.02, -0.02, 0.15], "look_at": [0, 0, 0], "fov": 150},
        [BALL | {"center": [-0.09, 0.17, 0.11], "radius": 1.16, "material_name": "white"}],
    ),
}


@pytest.mark.parametrize("control", WIDE)
def test_wide_beams_lose_nothing(control):
    truth = render(WIDE[control], beams=False).image
    np.testing.assert_array_equal(render(WIDE[control], lines=False).image, truth)
    with kernels(control):
        assert (render(WIDE[control], lines=False).image != truth).any()


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e30])
def test_any_length_of_the_camera_s_up(length):
    scene = seen_from_above(1, objects=[floor(0.5, light={"radiance": [1, 1, 1]})])
    scene["camera"] |= {"position": [0.3, 0.2, 1], "ref_up": [0, 1, 0], "fov": 40}
    expected = render(scene).image
    assert 0 < expected.mean() < 1
    scene["camera"]["ref_up"] = [0, length, 0]
    np.testing.assert_array_equal(render(scene).image, expected)


def test_a_camera_beyond_the_reach_of_float32_sees_nothing():
    scene = seen_from_above(1, objects=[floor(1e-20, light={"radiance": [1, 1, 1]})])
    scene["camera"] |= {"position": [1e30, 1e30, 1e30], "fov": 60}
    assert (render(scene).image == 0).all()


# Memory ---------------------------------------------------------------------------------------------------------------


def test_kernels_are_given_back():
    """A build leaked 2 MiB, for good."""

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc to read the memory in use from")
    device = Device()
    for count in (5, 30):
        before = resident()
        for _ in range(count):
            device.build("trace.cl", ["-DHAS_SPHERES=0"])
    assert resident() - before < 20 * MIB


# The command line -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--size", "65536x65536"], 2, "expected at most 2^28 pixels in all, got 65536 x 65536"),
        (["--device", "²"], 4, 'no OpenCL device matches "²"'),
        (["--device", "9" * 5000], 4, "no OpenCL device matches"),
        (["--size", "1x1", "-o", "x" * 250 + ".png"], 1, "cannot be written: file name too long"),
    ],
)
def test_the_command_line_answers_with_a_sentence(tmp_path, monkeypatch, capsys, words, code, message):
    monkeypatch.chdir(tmp_path)
    assert main(["render", "example:cornell", *words]) == code
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("fov", [1e-30, 1e-200, 5e-324])
def test_a_camera_of_next_to_no_angle_has_a_picture_though_not_every_matrix(fov):
    scene = seen_from_above(1, objects=[floor(0.5, light={"radiance": [1, 1, 1]})])
    scene["camera"]["fov"] = fov
    result = render(scene)
    np.testing.assert_array_equal(result.image, 1)
    assert all(np.isfinite(np.float32(m)).all() for name, m in result.metadata.items() if name.startswith("world"))
