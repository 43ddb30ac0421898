"""The scene's fingerprint changes with everything that a sample depends on, and with nothing else."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pyrt.scene import Film
from pyrt.scene_hash import scene_hash
from tests.render.everything import everything

SCENE = everything()
ROOT = Path(__file__).parents[2]


def with_shape(index, **changes):
    shapes = list(SCENE.shapes)
    shapes[index] = replace(shapes[index], **changes)
    return replace(SCENE, shapes=tuple(shapes))


def with_pixels(pixels):
    return replace(SCENE, textures=(*SCENE.textures[:-1], replace(SCENE.textures[-1], pixels=pixels)))


def test_it_is_the_same_in_another_process():
    code = "from tests.host.test_scene_hash import *; print(scene_hash(SCENE))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == scene_hash(SCENE) == scene_hash(everything())
    assert len(scene_hash(SCENE)) == 64


@pytest.mark.parametrize(
    "same",
    [
        replace(SCENE, name="another", spp=5, film=Film(3, 4), warnings=("dropped",)),
        with_shape(0, name="objects.floor"),
        replace(SCENE, camera=replace(SCENE.camera, fov=40)),  # an int, where the file's reader makes a float
        with_shape(2, vertices=np.asfortranarray(SCENE.shapes[2].vertices)),
    ],
)
def test_what_no_sample_depends_on_does_not_count(same):
    assert scene_hash(same) == scene_hash(SCENE)


def nudged(array):
    array = array.copy()
    array.flat[-1] = np.nextafter(array.flat[-1], np.inf)
    return array


@pytest.mark.parametrize(
    "other",
    [
        replace(SCENE, max_depth=3),
        replace(SCENE, camera=replace(SCENE.camera, fov=np.nextafter(40.0, 41.0))),
        replace(SCENE, shapes=SCENE.shapes[::-1]),
        with_shape(0, material=None),
        with_shape(2, vertices=nudged(SCENE.shapes[2].vertices)),
        with_shape(2, triangles=SCENE.shapes[2].triangles.reshape(-1, 3)[::-1]),
        with_pixels(nudged(SCENE.textures[-1].pixels)),
        with_pixels(SCENE.textures[-1].pixels.reshape(3, 5, 3)),
    ],
)
def test_every_change_of_the_content_counts(other):
    assert scene_hash(other) != scene_hash(SCENE)


def test_what_cannot_be_encoded_is_refused():
    with pytest.raises(TypeError, match="a scene holds a set"):
        scene_hash(replace(SCENE, lights=({1},)))
