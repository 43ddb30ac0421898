"""Rendering to a noise target or a time limit."""

import numpy as np
import pytest

import pyrt
from pyrt.adaptive import FIRST_SAMPLES
from pyrt.cli import main

SIZE = (64, 64)


@pytest.fixture(scope="module")
def renderer() -> pyrt.Renderer:
    return pyrt.Renderer(pyrt.load_scene("example:cornell"))


def relative_error(image: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(np.mean((image - truth) ** 2 / (truth**2 + 0.01))))


@pytest.fixture(scope="module")
def truth(renderer: pyrt.Renderer) -> np.ndarray:
    return renderer.render(4096, seed=99, size=SIZE).image.astype(np.float64)


def test_a_pixel_with_n_samples_has_the_bits_of_a_picture_with_n_samples(renderer):
    adaptive = renderer.render(seed=1, size=SIZE, noise=0.003)
    counts = np.unique(adaptive.samples)
    assert len(counts) > 2, "the target must make a difference between pixels"
    for count in counts:
        uniform = renderer.render(int(count), seed=1, size=SIZE)
        here = adaptive.samples == count
        np.testing.assert_array_equal(adaptive.image[here], uniform.image[here])


@pytest.mark.parametrize("noise", [0.01, 0.004])
def test_the_stated_error_is_reached_and_honest(renderer, truth, noise):
    result = renderer.render(seed=2, size=SIZE, noise=noise)
    true = relative_error(result.image, truth)
    assert result.stats["noise"] <= noise
    assert 0.6 * true < result.stats["noise"] < 2.0 * true


def test_adaptive_sampling_beats_as_many_samples_spread_evenly(renderer, truth):
    result = renderer.render(seed=3, size=SIZE, noise=0.003)
    even = renderer.render(int(np.ceil(result.samples.mean())), seed=3, size=SIZE)
    assert relative_error(result.image, truth) < 0.7 * relative_error(even.image, truth)


@pytest.mark.parametrize("pass_samples", [1 << 10, 1 << 21])
def test_a_time_limit_that_is_too_short_still_gives_every_pixel_its_first_samples(renderer, pass_samples):
    result = renderer.render(size=SIZE, time_limit=1e-6, pass_samples=pass_samples)
    assert result.samples.min() == FIRST_SAMPLES
    uniform = renderer.render(FIRST_SAMPLES, size=SIZE)
    here = result.samples == FIRST_SAMPLES
    np.testing.assert_array_equal(result.image[here], uniform.image[here])


def test_pass_size_does_not_change_an_adaptive_picture(renderer):
    few, many = (renderer.render(seed=4, size=SIZE, noise=0.004, pass_samples=n) for n in (1 << 10, 1 << 21))
    np.testing.assert_array_equal(few.samples, many.samples)
    np.testing.assert_array_equal(few.image, many.image)


def test_spp_limits_a_noise_target_and_the_exit_code_tells(tmp_path):
    arguments = ["render", "example:cornell", "--size", "16x16", "--noise", "1e-6", "-q", "-o", str(tmp_path / "a.png")]
    assert main([*arguments, "--spp", "64"]) == 5
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize("limits", [{"noise": 0.0}, {"noise": float("nan")}, {"time_limit": -1.0}])
def test_limits_must_be_positive(renderer, limits):
    with pytest.raises(pyrt.UsageError, match="expected a number > 0"):
        renderer.render(size=SIZE, **limits)
