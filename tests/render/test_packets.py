"""Samples traced side by side are the samples traced alone: packets change no bit, whatever their rays do."""

import numpy as np
import pytest

import pyrt
from pyrt.scene import Scene
from tests.controls import kernels

ALONE = ("-DPACKET=1",)


def render(scene: Scene, spp: int, flags: tuple[str, ...] = (), beams: bool = False) -> np.ndarray:
    """Without beams, so that every ray traverses the tree."""
    return pyrt.Renderer(scene, beams=beams, build_flags=flags).render(spp, size=(45, 31), seed=3).image


@pytest.mark.parametrize("name", ["mesh_room", "showcase"])
@pytest.mark.parametrize("spp", [3, 8])
def test_packets_find_what_single_rays_find(name, spp):
    scene = pyrt.load_scene(f"example:{name}")
    np.testing.assert_array_equal(render(scene, spp), render(scene, spp, ALONE))


@pytest.mark.parametrize("position", [(0, 1, 6.8), (0.3, 1.5, 0.9), (0, 1, 400)])
@pytest.mark.parametrize("fov", [1e-3, 60.0, 150.0])
def test_packets_find_it_from_anywhere(position, fov):
    """Rays into one octant traverse together, and rays into several one by one."""
    scene = pyrt.load_scene("example:cornell_two_lights", overrides={"camera.position": position, "camera.fov": fov})
    np.testing.assert_array_equal(render(scene, 2), render(scene, 2, ALONE))


def test_the_comparison_notices_intervals_that_are_too_small():
    scene = pyrt.load_scene("example:mesh_room")
    with kernels("shrunken intervals"):
        cut = render(scene, 8)
    assert (cut != render(scene, 8)).any()
