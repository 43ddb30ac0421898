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

# of overrides
PATHS = [
    "camera.fov",
    "film.resolution.0",
    "objects.0",
    "objects.0.center.1",
    "objects.99",
    "objects.-1.type",
    "objects",
]
PATHS += ["materials", "materials.m0.color", "integrator", "textures.new.type", "a..b", "", ".", "a\nb", "x" * 300]


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
            check_sentences(error.problems)
            return None


def check_sentences(problems: list[str]) -> None:
    assert problems
    for problem in problems:
        assert problem.isprintable()
        assert 10 < len(problem) < 1000
        assert " at 0x" not in problem


@pytest.mark.parametrize("problems", [[], [""], ["one line,\nand another"], ["x" * 1000], [f"it is {object()}"]])
def test_what_is_no_sentence_is_seen(problems):
    with pytest.raises(AssertionError):
        check_sentences(problems)


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
@given(cases(), st.lists(st.tuples(st.sampled_from(PATHS), json_values), min_size=1, max_size=3))
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
