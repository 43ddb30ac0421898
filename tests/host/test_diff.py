"""`pyrt diff`: the measures against closed forms and the FLIP of its authors, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pyrt.cli import main
from pyrt.compare import difference
from pyrt.image_io import linear_to_srgb, read_picture, write_image


@pytest.fixture
def pictures(tmp_path: Path) -> tuple[Path, Path]:
    """A grey picture, and one with three values changed, as EXR."""
    reference = np.full((4, 5, 3), 0.5, np.float32)
    image = reference.copy()
    image[2, 3] += (0.5, -0.25, 0.125)
    paths = tmp_path / "a.exr", tmp_path / "b.exr"
    for path, pixels in zip(paths, (image, reference), strict=True):
        write_image(path, pixels)
    return paths


def diff(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, dict[str, Any], str]:
    """Exit code, the JSON on stdout, and stderr."""
    status = main(["diff", *map(str, words), "--json"])
    out, err = capsys.readouterr()
    return status, json.loads(out) if out else {}, err


def test_measures_of_known_pictures(pictures, capsys):
    status, found, err = diff(capsys, *pictures)
    squares = 0.5**2 + 0.25**2 + 0.125**2
    assert (status, err) == (0, "")
    assert found["rmse"] == pytest.approx((squares / 60) ** 0.5)
    assert found["relmse"] == pytest.approx(squares / 60 / 0.26)
    assert found["mean"] == pytest.approx(0.375 / 60)
    assert found["max"] == 0.5
    assert found["worst"] == [3, 2]
    assert found["not_finite"] == 0
    assert 0 < found["flip"] < 1


def test_a_picture_does_not_differ_from_itself(pictures, capsys):
    _, found, _ = diff(capsys, pictures[0], pictures[0], "--fail-above", "max=0", "--fail-above", "flip=0")
    assert {found[name] for name in ("rmse", "relmse", "mean", "max", "flip")} == {0.0}


def scene_like(noise: float) -> np.ndarray:
    y, x = np.mgrid[0:48, 0:64] / 48
    pixels = np.stack([0.5 + 0.4 * np.sin(9 * x + 3 * y), x / 1.4, y * 0.5], axis=2)
    return (pixels + np.random.default_rng(1).normal(0, noise, pixels.shape)).clip(0, 1).astype(np.float32)


@pytest.mark.parametrize(("display", "scale", "expected"), [(True, 1.0, 0.144042), (False, 5.0, 0.206224)])
def test_flip_is_that_of_its_authors(display, scale, expected):
    """The expected values are flip_evaluator 1.7's, of evaluate(..., "LDR", inputsRGB=False) and (..., "HDR")."""
    found = difference(scale * scene_like(0.08), scale * scene_like(0.0), display=display)
    assert found.measures["flip"] == pytest.approx(expected, rel=1e-4)


def test_the_formats_of_one_picture_agree(tmp_path, capsys):
    pixels = scene_like(0.0)
    for name in ("a.exr", "a.png", "a.npy", "a.hdr", "a.tif"):
        write_image(tmp_path / name, pixels)
    write_image(tmp_path / "reference.npy", pixels)
    for name, limit in (("a.exr", 3e-4), ("a.png", 1e-2), ("a.npy", 0), ("a.hdr", 6e-3), ("a.tif", 0)):
        status, found, _ = diff(capsys, tmp_path / name, tmp_path / "reference.npy", "--fail-above", f"max={limit}")
        assert status == 0, (name, found)


def test_further_channels_do_not_count(tmp_path, capsys):
    pixels = scene_like(0.0)
    write_image(tmp_path / "a.exr", pixels, planes={"Z": pixels[..., 0], "albedo.R": pixels[..., 1]})
    write_image(tmp_path / "b.exr", pixels)
    assert diff(capsys, tmp_path / "a.exr", tmp_path / "b.exr", "--fail-above", "max=0")[0] == 0


@pytest.mark.parametrize(
    ("limits", "status"),
    [(["max=0.5"], 0), (["max=0.49"], 1), (["rmse=1", "mean=0.001"], 1), (["flip=1", "relmse=inf"], 0)],
)
def test_a_measure_above_its_limit_exits_with_1(pictures, limits, status, capsys):
    code, _, err = diff(capsys, *pictures, *(f"--fail-above={limit}" for limit in limits))
    assert code == status
    assert err.count("expected at most") == status


def test_a_negative_mean_counts_without_its_sign(pictures, capsys):
    assert diff(capsys, pictures[1], pictures[0], "--fail-above=mean=0.001")[0] == 1


def test_the_difference_picture(pictures, tmp_path, capsys):
    assert diff(capsys, *pictures, "-o", tmp_path / "d.exr")[0] == 0
    pixels = read_picture(tmp_path / "d.exr").pixels
    assert pixels[2, 3].tolist() == [0.5, 0.25, 0.125]
    assert pixels.sum() == 0.875
    assert diff(capsys, *pictures, "-o", tmp_path / "d.png", "--exposure", "1")[0] == 0
    shown = linear_to_srgb(read_picture(tmp_path / "d.png").pixels[2, 3])
    np.testing.assert_allclose(shown, linear_to_srgb(np.array([1, 0.5, 0.25])), atol=1 / 255)


def test_pixels_that_are_not_finite_are_counted_and_fail(pictures, tmp_path, capsys):
    bad = read_picture(pictures[1]).pixels.copy()
    bad[0, 0, 1], bad[1, 1, 2] = np.nan, np.inf
    write_image(tmp_path / "bad.exr", bad, half=False)
    status, found, err = diff(capsys, tmp_path / "bad.exr", pictures[1])
    assert (status, found["not_finite"], found["rmse"]) == (0, 2, 0.0)
    assert err == "warning: 2 pixels are not finite, and left out\n"
    assert diff(capsys, tmp_path / "bad.exr", pictures[1], "--fail-above=rmse=1")[0] == 1


def test_what_is_no_pair_of_pictures_is_refused_in_one_sentence(pictures, tmp_path, capsys):
    write_image(tmp_path / "small.exr", np.zeros((2, 5, 3)))
    (tmp_path / "text.png").write_text("no picture")
    np.save(tmp_path / "flat.npy", np.zeros((3, 3)))
    (tmp_path / "cut.npy").write_bytes((tmp_path / "flat.npy").read_bytes()[:-1])
    for name, message in (
        ("small.exr", "expected two pictures of one size, got 5 x 2 and 5 x 4 pixels"),
        ("text.png", "text.png: not a readable image"),
        ("missing.png", "missing.png: cannot be read: no such file or directory"),
        ("flat.npy", "flat.npy: expected an array (height, width, 3) of numbers, found (3, 3) float64"),
        ("cut.npy", "cut.npy: not a readable array"),
    ):
        status, found, err = diff(capsys, tmp_path / name, pictures[1])
        assert (status, found) == (2, {})
        assert message in err
        assert err.count("\n") == 1


@pytest.mark.parametrize("limit", ["rmse", "rmse=x", "rmse=-1", "rmse=nan", "=1", "flop=1"])
def test_limits_that_are_none_are_refused(pictures, limit, capsys):
    assert diff(capsys, *pictures, f"--fail-above={limit}")[0] == 2
