"""Random scenes: valid ones load, and whatever else is thrown at the loader, it answers with sentences."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrt.errors import SceneError
from pyrt.scene import Scene
from pyrt.scene_io import load_scene
from tests.strategies import Case, cases, damaged, examples, json_values, mutants


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


def load(source: Any, folder: Path, **options: Any) -> Scene | None:
    """The scene, or None if it was refused as it should be: without warnings on stderr, one sentence per problem."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return load_scene(source, base_dir=folder, **options)
        except SceneError as error:
            problems = error.problems
    assert problems
    for problem in problems:
        assert problem.isprintable(), problem
        assert len(problem) < 1000
        assert "object at 0x" not in problem
    return None


def check_valid(case: Case, folder: Path) -> None:
    case.write_files(folder)
    scene = load(case.scene, folder)
    assert scene is not None
    assert len(scene.shapes) == len(case.scene["objects"])


def check_mutant(case: Case, folder: Path) -> None:
    case.write_files(folder)
    load(case.scene, folder)


@examples(60)
@given(cases())
def test_valid_scenes_load(folder, case):
    check_valid(case, folder)


@examples(200)
@given(mutants())
def test_broken_scenes_are_refused_in_sentences(folder, case):
    check_mutant(case, folder)


@examples(60)
@given(st.data())
def test_damaged_scene_files_are_refused_in_sentences(folder, data):
    case = data.draw(mutants(only_json=True))
    case.write_files(folder)
    text = json.dumps(case.scene, ensure_ascii=data.draw(st.booleans())).encode("utf-8", "surrogatepass")
    (folder / "scene.json").write_bytes(data.draw(st.just(text) | damaged(text)))
    load(folder / "scene.json", folder)


@examples(60)
@given(st.data())
def test_damaged_assets_are_refused_in_sentences(folder, data):
    case = data.draw(cases().filter(lambda case: case.files))
    files = {name: data.draw(damaged(content)) for name, content in case.files.items()}
    check_mutant(Case(case.scene, files), folder)


@examples(60)
@given(cases(), st.lists(st.tuples(st.sampled_from(PATHS := [
    "camera.fov", "objects.0", "objects.0.center.1", "objects.99", "objects.-1.type", "materials.m0.color", "materials",
    "integrator", "film.resolution.0", "textures.new.type", "a..b", "", ".", "objects", "x" * 300, "a\nb", "objects.²",
]), json_values), min_size=1, max_size=3))
def test_broken_overrides_are_refused_in_sentences(folder, case, overrides):
    case.write_files(folder)
    load(case.scene, folder, overrides=dict(overrides))


@pytest.mark.slow
@examples(1000)
@given(cases())
def test_many_valid_scenes_load(folder, case):
    check_valid(case, folder)


@pytest.mark.slow
@examples(3000)
@given(mutants())
def test_many_broken_scenes_are_refused_in_sentences(folder, case):
    check_mutant(case, folder)
