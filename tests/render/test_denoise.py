"""Denoising brings pictures nearer to the truth and keeps the noisy ones; without its package, one sentence tells."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

import pyrt
from pyrt import denoise
from pyrt.cli import main
from pyrt.errors import PyrtError, UsageError
from pyrt.image_file import read_exr
from pyrt.image_io import read_picture, write_image

SIZE = (64, 48)
SCENE = "example:showcase"
installed = pytest.mark.skipif(find_spec("pyoidn") is None, reason="needs the extra package pyoidn")


@pytest.fixture(scope="module")
def renderer() -> pyrt.Renderer:
    return pyrt.Renderer(pyrt.load_scene(SCENE))


@pytest.fixture(scope="module")
def reference(renderer: pyrt.Renderer) -> np.ndarray:
    return renderer.render(128, seed=1, size=SIZE).image


def error(image: np.ndarray, reference: np.ndarray) -> float:
    """Relative mean square error."""
    return float(((image - reference) ** 2 / (reference**2 + 0.01)).mean())


@installed
def test_denoised_pictures_are_nearer_to_the_truth(renderer, reference):
    result = renderer.render(4, size=SIZE, denoise=True)
    assert result.aovs == {}
    np.testing.assert_array_equal(result.image, renderer.render(4, size=SIZE).image)
    noisy, clean = error(result.image, reference), error(result.denoised, reference)
    assert clean < 0.5 * noisy
    assert error(denoise.denoised(result.image), reference) > 1.1 * clean  # without what guides it


@installed
def test_wrong_guides_are_noticed(renderer, reference):
    """Negative control: the guides are used. Those of the picture upside down do harm."""
    result = renderer.render(4, size=SIZE, aovs=("denoising_albedo", "denoising_normal"))
    guides = [result.aovs[name] for name in ("denoising_albedo", "denoising_normal")]
    right, wrong = (denoise.denoised(result.image, *[g[::step] for g in guides]) for step in (1, -1))
    assert error(wrong, reference) > 1.2 * error(right, reference)


@installed
def test_files_hold_both_and_the_verb_does_the_same(tmp_path):
    outputs = [str(tmp_path / name) for name in ("a.exr", "a.npy")]
    options = ["--size", "64x48", "--spp", "4", "--aov", "denoising_albedo,denoising_normal,object", "-q"]
    assert main(["render", SCENE, "--denoise", *options, "-o", outputs[0], "-o", outputs[1]]) == 0
    stored = read_exr(outputs[0])
    clean = np.stack([stored.planes.pop(f"denoised.{c}") for c in "RGB"], axis=2)
    np.testing.assert_array_equal(read_picture(outputs[1]).pixels, clean)
    assert (stored.pixels != clean.astype(np.float16)).any()

    write_image(tmp_path / "b.exr", stored.pixels, planes=stored.planes, metadata=stored.metadata)
    assert main(["denoise", str(tmp_path / "b.exr"), "-o", str(tmp_path / "c.exr")]) == 0
    again = read_exr(tmp_path / "c.exr")
    np.testing.assert_array_equal(again.pixels, stored.pixels)
    np.testing.assert_array_equal(again.planes["object"], stored.planes["object"])
    assert again.metadata.keys() == stored.metadata.keys()
    twice = np.stack([again.planes[f"denoised.{c}"] for c in "RGB"], axis=2)
    np.testing.assert_allclose(twice, clean, rtol=0.02, atol=0.01)  # from halves


@installed
def test_a_picture_without_guides_is_denoised_with_a_warning(tmp_path, capsys):
    noisy = (np.random.default_rng(0).random((32, 32, 3)) < 0.5).astype(np.float32)
    write_image(tmp_path / "a.exr", noisy)
    assert main(["denoise", str(tmp_path / "a.exr"), "-o", str(tmp_path / "b.npy")]) == 0
    assert "a.exr: it has no channels denoising_albedo and denoising_normal" in capsys.readouterr().err
    assert np.load(tmp_path / "b.npy").std() < 0.5 * noisy.std()


@pytest.mark.parametrize("output", ["a.exr", "b.exr"])
def test_a_denoised_file_can_be_continued(output, tmp_path, monkeypatch, capsys):
    """Also by a stand-in for the denoiser."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(denoise, "denoised", lambda image, *guides: image / 2)
    monkeypatch.setattr(denoise, "require_denoiser", lambda: None)
    options = [SCENE, "--size", "16x12", "-q"]
    assert main(["render", *options, "--spp", "2", "--checkpoint", "1h", "-o", "a.exr"]) == 0
    assert main(["denoise", "a.exr", "-o", output]) == 0
    assert "denoised.R" in read_exr(output).planes
    assert main(["render", *options, "--spp", "4", "--resume", "-o", output]) == 0
    assert main(["render", *options, "--spp", "4", "-o", "whole.exr"]) == 0
    np.testing.assert_array_equal(read_exr(output).pixels, read_exr("whole.exr").pixels)


def test_guides_of_a_file_are_those_for_denoising_if_it_has_them():
    plane = {name: np.full((2, 2), value, np.float32) for value, name in enumerate(("first", "second"))}
    surface = {f"albedo.{c}": plane["first"] for c in "RGB"} | {f"N.{c}": plane["first"] for c in "XYZ"}
    through = {f"denoising_albedo.{c}": plane["second"] for c in "RGB"}
    through |= {f"denoising_normal.{c}": plane["second"] for c in "XYZ"}
    assert denoise.stored_guides({"Z": plane["first"]}) is None
    for planes, value in ((surface, 0), (surface | through, 1)):
        albedo, normal = denoise.stored_guides(planes)
        assert albedo.shape == normal.shape == (2, 2, 3)
        assert (albedo == value).all()


def test_a_library_that_fails_is_one_sentence(monkeypatch):
    class Broken:
        @staticmethod
        def denoise(*_, **__):
            raise RuntimeError("OIDN device creation failed")

    monkeypatch.setitem(__import__("sys").modules, "pyoidn", Broken)
    monkeypatch.setattr(denoise, "find_spec", lambda name: object())
    with pytest.raises(PyrtError, match="Open Image Denoise failed: OIDN device creation failed"):
        denoise.denoised(np.zeros((4, 4, 3), np.float32))


@pytest.mark.parametrize("arguments", [["render", SCENE, "--denoise"], ["denoise", "a.exr", "-o", "b.exr"]])
def test_without_the_package_the_message_names_the_cure(arguments, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(denoise, "find_spec", lambda name: None)
    assert main(arguments) == 2
    message = capsys.readouterr().err
    assert "pip install pyoidn" in message
    assert message.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_without_the_package_python_is_told_before_anything_is_rendered(renderer, monkeypatch):
    monkeypatch.setattr(denoise, "find_spec", lambda name: None)
    with pytest.raises(UsageError, match="pip install pyoidn"):
        renderer.render(1 << 20, size=(4096, 4096), denoise=True)
