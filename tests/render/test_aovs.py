"""AOVs against the float64 reference and closed forms; crops; what EXR files say about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pyrt
from pyrt.adaptive import FIRST_SAMPLES
from pyrt.aov import AOVS, NONE, check_aovs
from pyrt.camera import film_plane, world_to_camera
from pyrt.errors import UsageError
from pyrt.passes import SampleTracer
from pyrt.scene import Camera, Diffuse, Mesh, Rectangle, Refraction, Scene, Sphere
from tests.reference.geometry import build, closest
from tests.reference.rendering import make_scene
from tests.reference.tracer import camera_rays, texture_color
from tests.render.everything import SIZE, everything

SCENE = everything()
WIDTH, HEIGHT = SIZE


@pytest.fixture(scope="module")
def renderer() -> pyrt.Renderer:
    return pyrt.Renderer(SCENE)


@pytest.fixture(scope="module")
def result(renderer: pyrt.Renderer) -> pyrt.Result:
    return renderer.render(2, size=SIZE, aovs=AOVS)


def centres() -> tuple[np.ndarray, np.ndarray]:
    film = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), 2).reshape(-1, 2) + 0.5
    return camera_rays(SCENE.camera, SIZE, film)


@pytest.fixture(scope="module")
def truth() -> dict[str, np.ndarray]:
    """Of the pixels' centres, by brute force in float64."""
    origins, directions = centres()
    hits = closest(build(SCENE), origins, directions)
    found = hits.shape >= 0
    away = np.linalg.norm(hits.point - origins, axis=1)
    normal = hits.shading * np.where((hits.shading * hits.normal).sum(1) < 0, -1, 1)[:, None]
    normal *= np.where((hits.normal * directions).sum(1) > 0, -1, 1)[:, None]
    material = np.array([NONE if s.material is None else s.material for s in SCENE.shapes] + [NONE])[hits.shape]
    axis = np.subtract(SCENE.camera.look_at, SCENE.camera.position)
    rows = {
        "distance": np.where(found, away, np.inf),
        "z": np.where(found, away * (directions @ axis) / np.linalg.norm(axis), np.inf),
        "position": np.where(found[:, None], hits.point, 0),
        "normal": np.where(found[:, None], normal, 0),
        "uv": np.where(found[:, None], hits.uv, 0),
        "object": np.where(found, hits.shape, NONE),
        "material": np.where(found, material, NONE),
    }
    return {name: row.reshape(HEIGHT, WIDTH, *row.shape[1:]) for name, row in rows.items()}


def test_shapes_and_dtypes_are_as_documented(result):
    assert list(result.aovs) == list(AOVS)
    for name, aov in AOVS.items():
        k = len(aov.channels)
        assert result.aovs[name].shape == ((HEIGHT, WIDTH) if k == 1 else (HEIGHT, WIDTH, k))
        assert result.aovs[name].dtype == aov.dtype


def test_the_scene_shows_every_kind_of_surface_and_nothing(truth):
    seen = truth["object"]
    assert (seen == NONE).any()
    assert {type(SCENE.shapes[i]) for i in np.unique(seen[seen != NONE])} == {Mesh, Rectangle, Sphere}


@pytest.mark.parametrize("name", ["object", "material"])
def test_ids(name, result, truth):
    np.testing.assert_array_equal(result.aovs[name], truth[name])


@pytest.mark.parametrize("name", ["z", "distance", "position", "normal", "uv"])
def test_geometry_is_that_of_float64(name, result, truth):
    """Rounded to float32 at the end; the position is not."""
    tolerance = 1e-12 if name == "position" else 3e-7
    np.testing.assert_allclose(result.aovs[name], truth[name], rtol=tolerance, atol=tolerance)


def test_triangles_are_those_of_the_file(result):
    seen, triangle = result.aovs["object"], result.aovs["triangle"]
    for index in np.unique(seen[seen != NONE]):
        shape, here = SCENE.shapes[index], seen == index
        if isinstance(shape, Mesh):
            corners = shape.vertices[shape.triangles[triangle[here]]]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            off = ((result.aovs["position"][here] - corners[:, 0]) * normal).sum(1) / np.linalg.norm(normal, axis=1)
            assert np.abs(off).max() < 1e-12
        elif isinstance(shape, Rectangle):
            assert set(triangle[here]) <= {0, 1}
        else:
            assert (triangle[here] == NONE).all()


def test_variance_and_samples_are_the_results(result):
    assert result.aovs["variance"] is result.variance
    assert result.aovs["samples"] is result.samples


def flat(name, truth) -> np.ndarray:
    """Pixels whose whole neighbourhood shows one object."""
    seen = np.pad(truth["object"], 1, mode="edge")
    views = np.lib.stride_tricks.sliding_window_view(seen, (3, 3)).reshape(HEIGHT, WIDTH, 9)
    return (views == truth["object"][..., None]).all(2)


def test_albedo_is_the_textures_mean_over_the_pixel(result, truth):
    """Inside of constant and image textures, which 16 samples average well; glass is white, lamps and misses black."""
    albedo, whole = result.aovs["albedo"], flat("object", truth)
    kinds = {"glass": 0, "grey": 0, "black": 0}
    for y, x in np.argwhere(whole):
        index = truth["object"][y, x]
        material = None if index == NONE else SCENE.shapes[index].material
        if material is None:
            assert (albedo[y, x] == 0).all()
            kinds["black"] += 1
        elif not isinstance(SCENE.materials[material], Diffuse):
            np.testing.assert_allclose(albedo[y, x], 1, rtol=1e-6)
            kinds["glass"] += 1
        elif index in (2, 4):
            np.testing.assert_allclose(albedo[y, x], (0.7, 0.6, 0.5), rtol=1e-6)
            kinds["grey"] += 1
    assert min(kinds.values()) > 3
    wall = whole & (truth["object"] == 1)
    texture = SCENE.textures[SCENE.materials[SCENE.shapes[1].material].texture]
    rng = np.random.default_rng(0)
    for y, x in np.argwhere(wall)[::40]:
        film = np.array([x, y]) + rng.random((4000, 2))
        hits = closest(build(SCENE), *camera_rays(SCENE.camera, SIZE, film))
        np.testing.assert_allclose(albedo[y, x], texture_color(texture, hits.uv).mean(0), atol=0.03)


def test_guides_equal_the_first_surface_where_nothing_is_specular(result, truth):
    whole = flat("object", truth) & (truth["object"] == 0)
    np.testing.assert_array_equal(result.aovs["denoising_albedo"][whole], result.aovs["albedo"][whole])
    np.testing.assert_allclose(result.aovs["denoising_normal"][whole], result.aovs["normal"][whole], atol=1e-6)


def pane(eta: float) -> Scene:
    """A pane between the camera and a wall that looks the other way."""
    return make_scene(
        Rectangle(name="pane", center=(0, 0, 1), edge1=(4, 0, 0), edge2=(0, 4, 0), material=1),
        Rectangle(name="wall", center=(0, 0, 0), edge1=(9, 0, 0), edge2=(0, 9, 3), material=0),
        camera=Camera(position=(0, 0, 3), fov=30),
        materials=(Diffuse(0), Refraction(eta)),
    )


def test_guides_look_through_glass_and_albedo_does_not():
    result = pyrt.Renderer(pane(0.8)).render(1, size=(6, 4), aovs=("albedo", "denoising_albedo", "denoising_normal"))
    np.testing.assert_allclose(result.aovs["albedo"], 1, rtol=1e-6)
    np.testing.assert_allclose(
        result.aovs["denoising_albedo"], np.broadcast_to((0.5, 0.25, 0.75), (4, 6, 3)), rtol=1e-6
    )
    n = np.array([0, -3, 9]) / np.sqrt(90)
    np.testing.assert_allclose(result.aovs["denoising_normal"], np.broadcast_to(n, (4, 6, 3)), atol=1e-6)


def test_guides_end_at_the_depth_limit():
    shallow = replace(pane(0.8), max_depth=0)
    result = pyrt.Renderer(shallow).render(1, size=(6, 4), aovs=("denoising_albedo", "denoising_normal"))
    np.testing.assert_allclose(result.aovs["denoising_albedo"], 1, rtol=1e-6)
    np.testing.assert_allclose(result.aovs["denoising_normal"], np.broadcast_to((0, 0, 1), (4, 6, 3)), atol=1e-6)


@pytest.mark.parametrize(("scale", "center"), [(1e-3, 0.0), (2.0**20, 0.0), (1.0, 1e6)])
def test_geometry_is_in_world_units(scale, center):
    """A sphere in the middle, seen from 5 radii: its nearest point is 4 radii away."""
    middle = np.full(3, center)
    scene = make_scene(
        Sphere(name="ball", center=tuple(middle), radius=scale, material=0),
        camera=Camera(position=tuple(middle + (0, 0, 5 * scale)), look_at=tuple(middle), fov=1),
    )
    aovs = pyrt.Renderer(scene).render(1, size=(3, 3), aovs=("z", "distance", "position")).aovs
    np.testing.assert_allclose([aovs["z"][1, 1], aovs["distance"][1, 1]], 4 * scale, rtol=1e-7)
    np.testing.assert_allclose(
        aovs["position"][1, 1] - middle, (0, 0, scale), rtol=0, atol=1e-15 * center + 1e-12 * scale
    )


def test_a_sphere_from_inside():
    scene = make_scene(Sphere(name="ball", center=(0, 0, 1), radius=3, material=0), camera=Camera(fov=1))
    aovs = pyrt.Renderer(scene).render(1, size=(3, 3), aovs=("z", "normal")).aovs
    np.testing.assert_allclose(aovs["z"][1, 1], 3, rtol=1e-7)
    np.testing.assert_allclose(aovs["normal"][1, 1], (0, 0, 1), atol=1e-7)


def test_z_is_that_of_the_header_matrix(result):
    seen = result.aovs["object"] != NONE
    there = np.c_[result.aovs["position"][seen], np.ones(seen.sum())] @ world_to_camera(film_plane(SCENE.camera, *SIZE))
    np.testing.assert_allclose(there[:, 2], result.aovs["z"][seen], rtol=1e-6)


def test_passes_and_seeds_do_not_matter_for_geometry(renderer, result):
    again = renderer.render(1, seed=5, size=SIZE, aovs=("z", "normal", "triangle", "albedo"))
    for name in ("z", "normal", "triangle"):
        np.testing.assert_array_equal(again.aovs[name], result.aovs[name])
    assert (again.aovs["albedo"] != result.aovs["albedo"]).any()  # its samples are the picture's


@pytest.mark.parametrize("batch", [1, 7, 100])
def test_batches_change_nothing(batch, renderer, result, monkeypatch):
    monkeypatch.setattr("pyrt.aov._BATCH", batch * 64)
    again = renderer.render(1, size=SIZE, aovs=("position", "denoising_normal", "object"))
    for name, array in again.aovs.items():
        np.testing.assert_array_equal(array, result.aovs[name])


def test_a_picture_is_the_same_with_and_without(renderer, result):
    plain = renderer.render(2, size=SIZE)
    np.testing.assert_array_equal(plain.image, result.image)
    assert plain.aovs == {}


def test_nothing_is_compiled_that_nobody_asked_for():
    renderer = pyrt.Renderer(SCENE)
    renderer.render(1, size=(4, 4), aovs=("variance", "samples"))
    assert "_aov_kernels" not in vars(renderer._on_device)
    renderer.render(1, size=(4, 4), aovs=("z",))
    assert "_aov_kernels" in vars(renderer._on_device)


def test_unknown_names_are_listed():
    assert check_aovs(["z", "uv", "z"]) == ("z", "uv")
    with pytest.raises(UsageError, match=r'aov: expected some of z, distance, .*samples, got "depth"'):
        check_aovs(["z", "depth"])


# Crops ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("crop", [(0, 0, 40, 24), (7, 5, 22, 18), (39, 23, 40, 24), (0, 9, 40, 10)])
def test_a_crop_has_the_bits_of_the_whole(crop, renderer, result):
    x0, y0, x1, y1 = crop
    part = renderer.render(2, size=SIZE, crop=crop, aovs=AOVS)
    inside = np.s_[y0:y1, x0:x1]
    for found, whole in ((part.image, result.image), (part.variance, result.variance), (part.samples, result.samples)):
        np.testing.assert_array_equal(found, whole[inside])
    for name in AOVS:
        np.testing.assert_array_equal(part.aovs[name], result.aovs[name][inside])


def test_a_crop_of_another_place_has_other_bits(renderer, result, monkeypatch):
    """Negative control: as if the crop's pixels were counted from its corner."""
    trace, corner = SampleTracer.trace, np.uint32(7 | 5 << 16)
    monkeypatch.setattr(SampleTracer, "trace", lambda self, pixels, *rest: trace(self, pixels - corner, *rest))
    part = renderer.render(2, size=SIZE, crop=(7, 5, 22, 18))
    assert (part.image != result.image[5:18, 7:22]).any()


@pytest.mark.parametrize("crop", [(0, 0, 41, 24), (-1, 0, 4, 4), (5, 5, 5, 9), (9, 0, 4, 4), (0, 0, 4), (0, 0, 4.5, 4)])
def test_crops_outside_are_refused(crop, renderer):
    with pytest.raises(UsageError, match=r"crop: expected x0,y0,x1,y1 inside the picture, 40 x 24, got "):
        renderer.render(1, size=SIZE, crop=crop)


def test_a_crop_can_be_adaptive(renderer):
    part = renderer.render(64, size=SIZE, noise=0.05, crop=(7, 5, 22, 18))
    assert part.image.shape == (13, 15, 3)
    assert (part.samples >= FIRST_SAMPLES).all()
