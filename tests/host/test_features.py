"""The table of features: what switches each row on, and the options that the compiler gets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pyrt.features import build_options, feature_table, used_materials, used_textures
from pyrt.layout import kernel_dir
from pyrt.scene import (
    CheckerboardTexture,
    ConstantTexture,
    Dielectric,
    Diffuse,
    ImageTexture,
    Mesh,
    PointLight,
    Rectangle,
    Refraction,
    Scene,
    Shape,
    Sphere,
    SpotLight,
)

GREY = ConstantTexture((0.5, 0.5, 0.5))
IMAGE = ImageTexture(np.zeros((2, 2, 3), np.float32))
BOARD = CheckerboardTexture()
WALL = Rectangle(name="wall", center=(0, 0, 0), edge1=(1, 0, 0), edge2=(0, 1, 0), material=0)
BALL = Sphere(name="ball", center=(0, 0, 0), radius=1, material=0)
TRIANGLE = Mesh(name="mesh", vertices=np.eye(3), triangles=np.array([[0, 1, 2]], np.int32), material=0)
UVS, NORMALS = np.zeros((1, 3, 2), np.float32), np.ones((1, 3, 3), np.float32)
LIGHT = (1.0, 1.0, 1.0)
LAMP = PointLight((0, 0, 1), LIGHT)
PLAIN = Scene(textures=(GREY,), materials=(Diffuse(0),), shapes=(WALL, TRIANGLE), lights=(LAMP,))


def needed(scene: Scene) -> set[str]:
    return {row.macro.removeprefix("HAS_").lower() for row in feature_table(scene) if row.on}


def with_shape(shape: Shape) -> Scene:
    return replace(PLAIN, shapes=(*PLAIN.shapes, shape))


@pytest.mark.parametrize(
    ("scene", "features"),
    [
        (PLAIN, set()),
        (replace(PLAIN, textures=(BOARD,)), {"textures", "corners"}),
        (replace(PLAIN, textures=(BOARD,), shapes=(TRIANGLE,)), {"textures"}),
        (replace(PLAIN, textures=(IMAGE,)), {"textures", "images", "corners"}),
        (with_shape(BALL), {"spheres"}),
        (with_shape(replace(TRIANGLE, normals=NORMALS)), {"corners", "smooth_normals"}),
        (with_shape(replace(TRIANGLE, uvs=UVS)), set()),
        (replace(PLAIN, textures=(BOARD,), shapes=(replace(TRIANGLE, uvs=UVS),)), {"textures", "corners"}),
        (replace(PLAIN, materials=(Refraction(1.5),)), {"specular", "refraction"}),
        (replace(PLAIN, materials=(Dielectric(),)), {"specular", "dielectric"}),
        (replace(PLAIN, lights=(SpotLight((0, 0, 1), (0, 0, -1), LIGHT, 0, 45),)), {"spot_lights"}),
        (with_shape(replace(WALL, radiance=LIGHT)), {"area_lights", "rectangle_lights"}),
        (with_shape(replace(TRIANGLE, radiance=LIGHT)), {"area_lights", "mesh_lights"}),
        (with_shape(replace(BALL, radiance=LIGHT)), {"spheres", "area_lights", "sphere_lights"}),
        (with_shape(replace(WALL, material=None, radiance=LIGHT)), {"area_lights", "rectangle_lights"}),
    ],
)
def test_features_are_what_the_scene_needs(scene, features):
    assert needed(scene) == features


def test_what_no_shape_uses_is_not_needed():
    """Materials and textures that are only declared cost nothing."""
    materials = (Diffuse(0), Diffuse(1), Refraction(2), Dielectric())
    scene = replace(PLAIN, textures=(GREY, IMAGE, BOARD), materials=materials)
    assert needed(scene) == set()
    assert used_materials(scene) == [Diffuse(0)]
    assert used_textures(scene) == [0]
    assert used_textures(with_shape(replace(WALL, material=None, radiance=LIGHT))) == [0]


def test_reasons_count_things():
    rows = {row.macro: row for row in feature_table(replace(with_shape(BALL), textures=(IMAGE,)))}
    assert rows["HAS_IMAGES"].reason == "1 image textures"
    assert rows["HAS_MESH_LIGHTS"].reason == "no mesh lights"


def test_every_macro_is_always_passed():
    table = feature_table(with_shape(BALL))
    options = build_options(table)
    assert options == [f"-D{row.macro}={int(row.on)}" for row in table]
    assert sum(option.endswith("=1") for option in options) == 1
    assert all(option.endswith("=1") for option in build_options(table, everything=True))
    assert len(options) == len(build_options(feature_table(Scene())))


def test_every_macro_is_read_by_the_kernels():
    source = "".join(file.read_text(encoding="utf-8") for file in kernel_dir().glob("*.[hc]*"))
    for row in feature_table(Scene()):
        assert row.macro in source
