"""Leaving a feature, beams or shafts out of the kernels changes no bit of any picture that does not need them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import pyrt
from pyrt.features import build_options, feature_table
from pyrt.result import Result
from pyrt.scene import Scene
from tests.render.everything import everything

SCENES = sorted(file.stem for file in (Path(__file__).parents[2] / "scenes").glob("*.json"))


def render(scene: Scene, **options: bool) -> Result:
    return pyrt.Renderer(scene, **options).render(spp=4, size=(48, 36))


def same_bits(a: Result, b: Result) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("image", "variance", "samples"))


def slow(values: Sequence[object]) -> list[object]:
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.mark.parametrize("name", SCENES)
def test_all_features_give_the_same_picture(name):
    scene = pyrt.load_scene(f"example:{name}")
    assert not all(row.on for row in feature_table(scene))
    own = render(scene)
    assert own.image.max() > 0
    assert same_bits(own, render(scene, all_features=True))


@pytest.mark.parametrize("index", [1, *slow([i for i in range(len(everything().shapes)) if i != 1])])
def test_every_object_brings_what_it_needs(index):
    """Alone in its scene: the wall with its image, and (slow) each other object."""
    scene = everything()
    scene = replace(scene, shapes=(scene.shapes[index],))
    assert same_bits(render(scene), render(scene, all_features=True))


@pytest.mark.parametrize("name", ["everything", *slow(SCENES)])
def test_beams_give_the_same_picture(name):
    """What rays can hit is looked up ahead for bundles of them, or not at all."""
    scene = everything() if name == "everything" else pyrt.load_scene(f"example:{name}")
    assert same_bits(render(scene, lines=False), render(scene, beams=False))


def test_the_fullest_scene_needs_every_feature():
    assert all(row.on for row in feature_table(everything()))


MACROS = [row.macro for row in feature_table(Scene())]


@pytest.mark.parametrize("macro", [MACROS[0], *slow(MACROS[1:])])
def test_a_needed_feature_left_out_is_noticed(macro):
    """Each macro guards something: without it the fullest scene looks different."""
    scene = everything()
    wrong = [option for option in build_options(feature_table(scene)) if macro not in option]
    with patch("pyrt.device_scene.build_options", lambda table, everything: [*wrong, f"-D{macro}=0"]):
        without = render(scene)
    assert not same_bits(without, render(scene))
