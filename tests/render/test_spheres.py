"""Spheres and smooth meshes: where they are, how they are lit and textured, and what they hide."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pyrt.scene import (
    Camera,
    CheckerboardTexture,
    Dielectric,
    Diffuse,
    ImageTexture,
    Mesh,
    PointLight,
    Rectangle,
    Sphere,
)
from tests.reference import analytic
from tests.reference.analytic import Array
from tests.reference.rendering import ALBEDO, assert_renders, make_scene, replicates
from tests.reference.statistics import replicate
from tests.reference.tracer import pixel_average, reference_image

SIZE = (12, 12)
BALL = Sphere(name="ball", center=(0.0, 0.0, 0.0), radius=1.0, material=0)
FLOOR = Rectangle(name="floor", center=(0, -1, 0), edge1=(0, 0, 9), edge2=(9, 0, 0), material=0)
CAMERA = Camera((1, 2, 5), (0, 0, 0), (0, 1, 0), 32)
LIGHT = PointLight((4.0, 3.0, 5.0), (90.0, 80.0, 70.0))
LAMP = Rectangle(name="lamp", center=(0, 3, 0), edge1=(1, 0, 0), edge2=(0, 0, 1), radiance=(9.0, 8.0, 7.0))


def first_hit(origins: Array, directions: Array, radius: float) -> Array:
    """Where rays meet the front of a sphere around the origin."""
    along = (origins * directions).sum(1, keepdims=True)
    discriminant = along**2 - (origins**2).sum(1, keepdims=True) + radius**2
    assert (discriminant > 0).all()
    return origins - (along + np.sqrt(discriminant)) * directions


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e4])
def test_sphere_is_shaded_by_its_normal(radius):
    """Pixels that lie wholly on the sphere, near the camera's axis, against the closed form at the exact hit."""
    camera = Camera((2 * radius, 3 * radius, 5 * radius), (0, 0, 0), (0, 1, 0), 12)
    position = (3 * radius, 4 * radius, 5 * radius)
    scene = make_scene(replace(BALL, radius=radius), camera=camera, lights=(PointLight(position, LIGHT.flux),))

    def radiance(origins: Array, directions: Array) -> Array:
        points = first_hit(origins, directions, radius)
        return np.array(ALBEDO) / np.pi * analytic.point_irradiance(points, points / radius, position, LIGHT.flux)

    assert_renders(scene, pixel_average(camera, SIZE, radiance), spp=1024, bias=1e-5)


@pytest.mark.parametrize("distance", [2.0, 10.0, 1e4])
def test_sphere_covers_its_cone(distance):
    """Seen along its axis, a sphere is a disc of half-angle asin(r / d)."""
    camera = Camera((0, 0, distance), (0, 0, 0), (0, 1, 0), 2.4 * math.degrees(math.asin(1 / distance)))
    scene = make_scene(replace(BALL, radiance=(1.0, 1.0, 1.0), material=None), camera=camera)
    half = math.tan(math.radians(camera.fov) / 2)
    covered = math.pi * (math.tan(math.asin(1 / distance)) / half) ** 2 / 4
    coverage = replicate(replicates(scene, 256, (64, 64))[..., 0].mean((1, 2)))
    assert abs(coverage.mean - covered) < 4 * math.sqrt(coverage.variance) + 2e-6 < 5e-5


INNER = Sphere(name="inner", center=(0.3, 0, 0), radius=0.1, radiance=(9.0, 9.0, 9.0))
OUTER = Sphere(name="outer", center=(2, 3, 0), radius=0.6, material=0, radiance=(9.0, 8.0, 7.0))
SCENES = {
    "shadow of a point light": ((BALL, FLOOR), {"lights": (LIGHT,)}),
    "penumbra of a rectangle": ((BALL, FLOOR, LAMP), {}),
    "penumbra of a sphere light": ((BALL, FLOOR, OUTER), {}),
    "inside of a sphere": ((replace(BALL, radius=1.5), INNER), {"camera": Camera((0, 0, 1.4), fov=80)}),
}


@pytest.mark.parametrize("name", SCENES)
def test_sphere_casts_and_receives_light_as_the_reference_says(name):
    shapes, options = SCENES[name]
    scene = make_scene(*shapes, **{"camera": CAMERA, **options})
    assert_renders(scene, reference_image(scene, SIZE, 8, 3), spp=256)


# Texture coordinates --------------------------------------------------------------------------------------------------


def stripes(count: int, axis: int) -> ImageTexture:
    """`count` texels of different colours, along s (axis 1) or t (axis 0)."""
    colors = np.random.default_rng(count).random((count, 3)).astype(np.float32)
    return ImageTexture(colors[None] if axis == 1 else colors[:, None])


TEXTURES = {
    "longitude": stripes(8, 1),
    "latitude": stripes(5, 0),
    "globe": replace(stripes(6, 1), scale=(3.0, 2.0), delta=(0.1, -0.3)),
    "checkerboard": CheckerboardTexture((0.9, 0.8, 0.1), (0.1, 0.1, 0.4), scale=(4.0, 2.0)),
}


@pytest.mark.parametrize("position", [(1, 2, 5), (-5, 1, 0.3), (0.1, 5, 0.2), (5, -2, -1e-3)], ids=str)
@pytest.mark.parametrize("texture", TEXTURES.values(), ids=TEXTURES.keys())
def test_sphere_is_textured_by_longitude_and_latitude(texture, position):
    """From several sides: the seam at +x, and both poles among them."""
    light = PointLight(tuple(2.0 * np.array(position)), LIGHT.flux)
    camera = Camera(position, (0, 0, 0), (0.3, 1, 0), 26)
    scene = make_scene(BALL, camera=camera, lights=(light,), textures=(texture,))
    assert_renders(scene, reference_image(scene, SIZE, 8), spp=256)


def test_u_grows_from_x_towards_z_and_v_downwards():
    """One eighth of the globe each: (u, v) = (1/8, 1/4) lies between +x, +z and +y."""
    pixels = np.zeros((2, 4, 3), np.float32)
    pixels[0, 0] = 1
    brightness = []
    for octant in np.array(np.meshgrid((1, -1), (1, -1), (1, -1))).reshape(3, -1).T:
        eye = tuple(5.0 * octant)
        scene = make_scene(
            BALL,
            camera=Camera(eye, fov=1, look_at=(0, 0, 0)),
            lights=(PointLight(eye, LIGHT.flux),),
            textures=(ImageTexture(pixels),),
        )
        lit = replicates(scene, 4, (1, 1), 1)
        brightness.append(lit[0, 0, 0, 0])
    assert np.argmax(brightness) == 0
    assert brightness[0] > 5 * max(brightness[1:])


# Smooth normals -------------------------------------------------------------------------------------------------------


def octasphere(smooth: bool, material: int = 0) -> Mesh:
    """32 triangles between points of the unit sphere, with the sphere's normals if smooth."""
    signs = np.array(np.meshgrid((1, -1), (1, -1), (1, -1))).reshape(3, -1).T
    faces = np.array([np.diag(s)[:: int(s.prod())] for s in signs], float)
    middle = analytic.unit(faces + np.roll(faces, -1, 1))
    corner = [np.stack([faces[:, i], middle[:, i], middle[:, i - 1]], 1) for i in range(3)]
    vertices = np.concatenate([*corner, middle])
    return Mesh(
        name="octasphere",
        material=material,
        vertices=vertices.reshape(-1, 3),
        triangles=np.arange(96, dtype=np.int32).reshape(-1, 3),
        normals=vertices.astype(np.float32) if smooth else None,
    )


@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("lamp", ["point", "rectangle"])
def test_shading_normals_give_cosines_and_geometric_ones_sides(smooth, lamp):
    """Up to the terminator, where the two disagree."""
    lights = (LIGHT,) if lamp == "point" else ()
    scene = make_scene(octasphere(smooth), FLOOR, *(() if lights else (LAMP,)), camera=CAMERA, lights=lights)
    assert_renders(scene, reference_image(scene, SIZE), spp=256)


def test_glass_refracts_by_its_shading_normal():
    glass = (Diffuse(0), Dielectric(1.5, 1.0))
    scene = make_scene(octasphere(True, 1), FLOOR, camera=CAMERA, lights=(LIGHT,), materials=glass, max_depth=3)
    assert_renders(scene, reference_image(scene, SIZE, 8, 3), spp=256)


@pytest.mark.parametrize(("height", "lit"), [(0.1, True), (-0.1, False)])
def test_light_behind_the_surface_does_not_shine_through_however_normals_lean(height, lit):
    """One open triangle whose shading normals lean towards a light just above or below its plane."""
    leaning = np.broadcast_to(np.float32((math.sqrt(0.5), math.sqrt(0.5), 0)), (1, 3, 3))
    sail = Mesh(
        name="sail",
        material=0,
        vertices=np.array([(-1, 0, 1), (1, 0, 1), (0, 0, -2.0)]),
        triangles=np.array([(0, 1, 2)], np.int32),
        normals=leaning,
    )
    camera = Camera((0, 5, 0), (0, 0, 0), (0, 0, -1), 1)
    scene = make_scene(sail, camera=camera, lights=(PointLight((5, height, 0), LIGHT.flux),))
    assert (replicates(scene, 4, (4, 4), 1) > 0).all() == lit
    assert (replicates(scene, 4, (4, 4), 1) == 0).all() != lit
