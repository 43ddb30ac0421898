"""Beams and shafts save work and change nothing but, by lines, the noise of rectangle lights."""

import numpy as np
import pytest

import pyrt
from tests.controls import kernels

SCENES = ["cornell", "cornell_two_lights", "cornell_area_light", "mesh_room", "showcase"]
SIZE, SPP = (96, 72), 4


def render(name: str, **options: bool) -> pyrt.Result:
    return pyrt.Renderer(pyrt.load_scene(f"example:{name}"), lines=False, **options).render(spp=SPP, size=SIZE, seed=5)


@pytest.mark.parametrize("name", SCENES)
def test_beams_save_shadow_rays_and_change_no_bit(name):
    with_beams, without = render(name), render(name, beams=False)
    np.testing.assert_array_equal(with_beams.image, without.image)
    saved = with_beams.stats["skipped"]["shadow_rays_in_clear_shafts"]
    assert saved > 0
    assert without.stats["skipped"]["shadow_rays_in_clear_shafts"] == 0
    assert with_beams.stats["rays"]["shadow"] + saved == without.stats["rays"]["shadow"]


@pytest.mark.parametrize("position", [(0, 1, 6.8), (0.3, 1.5, 0.9), (-0.95, 0.05, 0.9), (0, 1, 400)])
@pytest.mark.parametrize("fov", [2.0, 60.0, 150.0])
def test_beams_change_no_bit_from_anywhere(position, fov):
    overrides = {"camera.position": position, "camera.fov": fov}
    scene = pyrt.load_scene("example:cornell_two_lights", overrides=overrides)
    images = [
        pyrt.Renderer(scene, beams=beams, lines=False).render(spp=2, size=(61, 43)).image for beams in (True, False)
    ]
    np.testing.assert_array_equal(*images)


@pytest.mark.parametrize("control", ["shrunken volumes", "receivers' planes moved up"])
def test_the_comparison_notices_volumes_that_are_too_small(control):
    with kernels(control):
        cut = render("cornell_area_light")
    assert (cut.image != render("cornell_area_light", beams=False).image).any()
