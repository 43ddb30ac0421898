"""What random scenes and command lines (test_fuzz_*) have found, each with the least input that shows it."""

from __future__ import annotations

import json
import os
import struct
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pyrt.cli import main
from pyrt.errors import SceneError, UsageError
from pyrt.image_io import check_output, read_texture
from pyrt.mesh_io import load_mesh
from pyrt.pack import pack_scene
from pyrt.scene import PointLight, Rectangle, Scene, Shape, Sphere
from pyrt.scene_io import load_scene

LONG = "x" * 300
NOT_UTF8 = os.fsdecode(b"\xff")
SCENE = {"objects": [{"type": "sphere", "center": [0, 0, -3], "radius": 1, "light": {"radiance": [1, 1, 1]}}]}


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def icosphere(**fields: Any) -> Any:
    scene = load_scene(
        {"objects": [{"type": "icosphere", "subdivisions": 0, "light": {"radiance": [1, 1, 1]}, **fields}]}
    )
    return scene.shapes[0]


# Loading --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["a\nb", "\0", "\ud800", "\u202e", "\x1b[2J"])
def test_what_cannot_be_printed_is_escaped(text, tmp_path):
    mesh = {"type": "mesh", "path": f"{text}.obj", "light": {"radiance": [1, 1, 1]}}
    with pytest.raises(SceneError) as caught:
        load_scene({"film": text, "objects": [mesh]}, base_dir=tmp_path)
    assert len(caught.value.problems) == 2
    assert all(problem.isprintable() for problem in caught.value.problems)


def test_an_icosphere_as_small_as_numbers_are_has_normals():
    np.testing.assert_array_equal(icosphere(radius=5e-324).normals, icosphere().normals)


def test_a_mesh_whose_areas_underflow_has_an_area(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1e-200 0 0\nv 0 1e-200 0\nf 1 2 3\n")
    mesh = {"type": "mesh", "path": "a.obj", "light": {"radiance": [1, 1, 1]}}
    assert len(load_scene({"objects": [mesh]}, base_dir=tmp_path).shapes) == 1


def test_a_mesh_beyond_the_largest_coordinate_is_refused(tmp_path):
    """It was accepted, and then dropped."""
    (tmp_path / "a.obj").write_text("v 0 0 1e31\nv 1e31 0 0\nv 0 1e31 0\nf 1 2 3\n")
    mesh = {"type": "mesh", "path": "a.obj", "light": {"radiance": [1, 1, 1]}}
    with pytest.raises(SceneError, match="all its coordinates below 1e\\+30"):
        load_scene({"objects": [mesh]}, base_dir=tmp_path)


@pytest.mark.parametrize("length", [1e300, 1e-300])
def test_normals_of_any_length(length, tmp_path):
    (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvn {length} 0 0\nf 1//1 2//1 3//1\n")
    assert (load_mesh(tmp_path / "a.obj").normals == (1, 0, 0)).all()


def test_mesh_attributes_that_are_not_finite(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv inf 0 0\nvt 1e300 nan\nvn 0 0 0\nf 1/1/1 2/1/1 3/1/1\nf 1/1/1 2/1/1 4/1/1\n"
    (tmp_path / "a.obj").write_text(text)
    assert len(load_mesh(tmp_path / "a.obj").triangles) == 2


def test_a_texel_that_overflows_when_decoded(tmp_path):
    (tmp_path / "a.pfm").write_bytes(b"PF\n1 1\n-1.0\n" + struct.pack("<3f", 3e38, 0, 0))
    with pytest.raises(SceneError, match="1 pixels are not finite"):
        read_texture(tmp_path / "a.pfm", "srgb")


# Packing --------------------------------------------------------------------------------------------------------------


def packed(*shapes: Shape, lights: tuple[PointLight, ...] = ()) -> dict[str, Any]:
    return pack_scene(Scene(shapes=shapes, lights=lights)).arrays


def square(center: Any, size: float) -> Rectangle:
    sides = {"edge1": (size, 0.0, 0.0), "edge2": (0.0, size, 0.0)}
    return Rectangle(name="square", center=center, radiance=(1.0, 1.0, 1.0), **sides)


BALL = Sphere(name="ball", center=(0.0, 0.0, 0.0), radius=1.0)


def test_triangles_that_normalisation_flattens_keep_their_normals():
    # beside a ball 1e13 times as large, at a place where float64 has 1e-3 for the difference of two coordinates
    large = Sphere(name="ball", center=(1e13, 0.0, 0.0), radius=1e13)
    tilted = Rectangle(name="square", center=(0.0, 0.0, 0.0), edge1=(1e-9, 0.0, 0.0), edge2=(0.0, 1e-9, 1e-9))
    normals = packed(large, tilted)["triangles"]["n"]
    np.testing.assert_allclose(normals, [(0, -(0.5**0.5), 0.5**0.5)] * 2, rtol=1e-6)


def test_a_light_whose_area_underflows_has_a_normal():
    (light,) = packed(square((0.0, 0.0, 0.0), 1e-170), BALL)["lights"]
    np.testing.assert_array_equal(light["n"], (0, 0, 1))
    assert light["area"] == 0


def test_mesh_lights_whose_areas_underflow_share_their_light():
    mesh = icosphere(radius=1e-170)
    cdf = packed(mesh, BALL)["cdf"].astype(float)
    np.testing.assert_allclose(np.diff(cdf), 2**32 / 20, rtol=1e-6)


@pytest.mark.parametrize("position", [(0.0, 0.0, 2e-30), (0.0, 0.0, 1e30)])
def test_point_lights_of_tiny_scenes_are_finite(position):
    light = PointLight(position, (1e30, 1.0, 0.0))
    (row,) = packed(square((0.0, 0.0, 0.0), 1e-30), lights=(light,))["lights"][:1]
    assert np.isfinite(row["position"]).all()
    assert np.isfinite(row["emission"]).all()


# The command line -----------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("scene.json", f"{NOT_UTF8}.json"):
        (tmp_path / name).write_text(json.dumps(SCENE))
    return tmp_path


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["validate", f"example:{LONG}"], 3, "no example scene"),
        (["render", "scene.json", "-o", f"{LONG}/{LONG}.png"], 2, "there is no folder"),
        (["render", "scene.json", "--exposure", "1e9"], 2, "exposure: expected stops from -120 to 120, got 1e+09"),
        (["render", "scene.json", "--exposure", "nan"], 2, "exposure: expected stops from -120 to 120, got nan"),
        (["validate", "scene.json", "--set", "camera=" + "[" * 100_000], 3, "camera: expected an object"),
        (["render", f"{NOT_UTF8}.json"], 2, "can be written as UTF-8"),
    ],
)
def test_the_command_line_answers_with_a_sentence(folder, capsys, words, code, message):
    assert main(words) == code
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--spp=--", "--size=--", "--set=--", "--output=--"])
def test_a_value_of_two_dashes_is_wrong_usage(folder, capsys, option):
    assert main(["render", "scene.json", option]) == 2


@pytest.mark.parametrize("size", ["²x²", "9x", "x", "1x1x1", "9" * 5000 + "x1"])
def test_a_size_that_is_none_is_wrong_usage(folder, capsys, size):
    assert main(["render", "scene.json", "--size", size]) == 2
    assert "expected WIDTHxHEIGHT" in capsys.readouterr().err


def test_names_that_are_no_text_are_printed(folder, capsys):
    assert main(["validate", f"{NOT_UTF8}.json"]) == 0
    assert main(["info", f"{NOT_UTF8}.json"]) == 0


def test_textures_whose_name_is_no_text_are_refused(tmp_path):
    path = Path(tmp_path, f"{NOT_UTF8}.ppm")
    path.write_bytes(b"P6\n1 1\n255\n\0\0\0")
    with pytest.raises(SceneError, match="can be written as UTF-8"):
        read_texture(path)
    with pytest.raises(UsageError, match="can be written as UTF-8"):
        check_output(path.with_suffix(".png"))
