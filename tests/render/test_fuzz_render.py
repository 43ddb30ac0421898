"""N29: random scenes with extreme parameters. No crash, no NaN, no negative pixel; bounded memory and work."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from pyrt.renderer import Renderer
from pyrt.result import Result
from pyrt.scene_io import load_scene
from tests.strategies import Case, cases, examples

PATHS = 64  # that a camera ray may split into at glass


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


def render(case: Case, folder: Path, **options: bool) -> Result:
    """Nothing on the way may warn. All features are compiled in, so that all scenes share the kernels."""
    case.write_files(folder)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Renderer(load_scene(case.scene, base_dir=folder), all_features=True, **options).render()


def check(case: Case, folder: Path) -> None:
    result = render(case, folder)
    for plane in (result.image, result.variance):
        assert np.isfinite(plane).all()
        assert plane.min() >= 0
    assert result.stats["dropped"]["samples"] == 0
    assert (result.samples == case.scene["integrator"]["spp"]).all()
    check_work(case, result)


def check_work(case: Case, result: Result) -> None:
    rays, skipped = result.stats["rays"], result.stats["skipped"]
    depth = case.scene["integrator"].get("max_depth", 16)
    assert rays["specular"] <= result.stats["samples"] * PATHS * depth
    towards_lights = rays["shadow"] + sum(skipped.values())
    assert towards_lights <= result.stats["samples"] * PATHS * result.stats["scene"]["lights"]


@examples(120)
@given(cases())
def test_random_scenes(folder, case):
    check(case, folder)


@examples(30)
@given(cases())
def test_random_scenes_are_the_same_without_beams(folder, case):
    with_beams, without = render(case, folder, lines=False), render(case, folder, beams=False)
    np.testing.assert_array_equal(with_beams.image, without.image)


@pytest.mark.slow
@examples(1000)
@given(cases())
def test_many_random_scenes(folder, case):
    check(case, folder)


@pytest.mark.slow
@examples(1000)
@given(cases())
def test_many_random_scenes_are_the_same_without_beams(folder, case):
    with_beams, without = render(case, folder, lines=False), render(case, folder, beams=False)
    np.testing.assert_array_equal(with_beams.image, without.image)
