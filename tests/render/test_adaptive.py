"""Rendering to a noise target or a time limit."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyrt
from bench.scenes import ERROR_SCENES
from pyrt.adaptive import FIRST_SAMPLES, summary
from pyrt.cli import main
from pyrt.guide import GAIN_BINS, GAIN_STEPS, LOW_GAIN, Guide
from pyrt.layout import constants
from pyrt.partial import Adaptive

SIZE = (40, 40)
TRUTH_SEEDS = (991, 992)


@lru_cache(maxsize=2)
def scene_renderer(name: str) -> pyrt.Renderer:
    return pyrt.Renderer(ERROR_SCENES[name]())


@lru_cache(maxsize=4)
def truth(name: str, spp: int = 1024) -> NDArray[np.float64]:
    """Two independent pictures (2, height, width, 3): the product of the differences to both has no noise of theirs."""
    return np.array([scene_renderer(name).render(spp, seed, SIZE).image for seed in TRUTH_SEEDS], np.float64)


def squared_error(image: NDArray[Any], halves: NDArray[np.float64]) -> float:
    return float(((image - halves[0]) * (image - halves[1]) / (halves.mean(axis=0) ** 2 + 0.01)).mean())


def dishonesty(name: str, noise: float, seeds: int = 3, spp: int = 1024) -> float:
    """The true error over the stated one, both averaged over seeds."""
    results = [scene_renderer(name).render(spp, seed, SIZE, noise=noise) for seed in range(seeds)]
    true = sum(squared_error(result.image, truth(name)) for result in results)
    return float(np.sqrt(max(true, 0.0) / sum(result.stats["noise"] ** 2 for result in results)))


@pytest.fixture(scope="module")
def renderer() -> pyrt.Renderer:
    return scene_renderer("cornell")


def let_each_judge_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """The control of looking at neighbours: a pixel whose samples agree by chance stops for good."""

    def gains(guide: Guide, values: Any, kinds: Any, factors: Any, means: Any, shifts: Any) -> NDArray[np.uint32]:
        own = np.log2(np.maximum(values * factors.ravel()[kinds], 1e-30)) + shifts.ravel()[kinds]
        bins = np.clip((own - LOW_GAIN) * GAIN_STEPS, 0, GAIN_BINS - 1)
        return (kinds.astype(np.uint32) * GAIN_BINS + bins).astype(np.uint32)

    monkeypatch.setattr(Guide, "gains", gains)


def all_of_class(name: str) -> Any:
    index = constants()[f"PIXEL_{name}"]
    return lambda guide, ahead, scratch: np.full(len(ahead.beams), index, np.uint8)


# Samples --------------------------------------------------------------------------------------------------------------


def test_a_pixel_with_n_samples_has_the_bits_of_a_picture_with_n_samples(renderer):
    adaptive = renderer.render(seed=1, size=SIZE, noise=0.003)
    counts = np.unique(adaptive.samples)
    assert len(counts) > 2, "the target must make a difference between pixels"
    for count in counts:
        uniform = renderer.render(int(count), seed=1, size=SIZE)
        here = adaptive.samples == count
        np.testing.assert_array_equal(adaptive.image[here], uniform.image[here])


def test_pass_size_does_not_change_an_adaptive_picture(renderer):
    few, many = (renderer.render(seed=4, size=SIZE, noise=0.004, pass_samples=n) for n in (1 << 10, 1 << 21))
    np.testing.assert_array_equal(few.samples, many.samples)
    np.testing.assert_array_equal(few.image, many.image)


@pytest.mark.parametrize("pass_samples", [1 << 10, 1 << 21])
def test_a_time_limit_that_is_too_short_still_gives_every_pixel_its_first_samples(renderer, pass_samples):
    result = renderer.render(size=SIZE, time_limit=1e-6, pass_samples=pass_samples)
    assert (result.samples == FIRST_SAMPLES).all()
    np.testing.assert_array_equal(result.image, renderer.render(FIRST_SAMPLES, size=SIZE).image)


@pytest.mark.parametrize("spp", [1, 2, 3, 50])
def test_no_pixel_gets_more_samples_than_allowed(renderer, spp):
    result = renderer.render(spp, size=(9, 7), noise=1e-6)
    assert spp / 2 < result.samples.min() <= result.samples.max() <= spp
    assert (result.stats["noise"] is None) == (spp < 2)


def test_adaptive_sampling_beats_as_many_samples_spread_evenly(renderer):
    result = renderer.render(seed=3, size=SIZE, noise=0.003)
    even = renderer.render(int(np.ceil(result.samples.mean())), seed=3, size=SIZE)
    assert squared_error(result.image, truth("cornell")) < 0.3 * squared_error(even.image, truth("cornell"))


# Errors ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "noise"),
    [
        *(("cornell", noise) for noise in (0.1, 0.03, 0.01, 0.003)),
        *(("clutter", noise) for noise in (0.1, 0.03)),
        *(pytest.param("cornell", noise, marks=pytest.mark.slow) for noise in (1e-3, 3e-4)),
        *(pytest.param("clutter", noise, marks=pytest.mark.slow) for noise in (0.01, 3e-3)),
        *(
            pytest.param(scene, noise, marks=pytest.mark.slow)
            for scene in ("area light room", "textured room", "mesh room", "cornell refraction")
            for noise in (0.1, 0.03, 0.01, 0.003)
        ),
    ],
)
def test_the_stated_error_is_honest(scene, noise):
    """Within a factor of 1.5, whether the target is reached or not."""
    assert 1 / 1.5 < dishonesty(scene, noise) < 1.5


def test_pixels_that_judge_themselves_state_too_little(monkeypatch):
    let_each_judge_itself(monkeypatch)
    assert dishonesty("cornell", 0.003) > 2.5


def sparkling(pixels: int) -> tuple[Adaptive, float]:
    """Four independent samples of pixels that all show 0.28, mostly 0.2 and sometimes 4.2; their true squared error."""
    samples = np.full((3, 1), 0.2) + 4 * (np.random.default_rng(0).random((4, 1, pixels)) < 0.02)
    state, mean = Adaptive.empty(pixels), samples.mean(axis=0)
    apart = (samples[:2].mean(axis=0) - samples[2:].mean(axis=0)) ** 2 / 4
    error = (apart / (mean**2 + 0.01)).mean(axis=0)
    sums, count = np.array([samples.sum(axis=0), (samples**2).sum(axis=0)]), state.count + np.uint32(4)
    made = replace(state, sums=sums, count=count, error=error, decay=np.full_like(state.decay, 0.5))
    return made, float(((mean - 0.28) ** 2 / (0.28**2 + 0.01)).mean())


def test_pixels_that_are_bright_by_chance_state_their_errors(monkeypatch):
    state, true = sparkling(6400)
    assert 1 / 1.5 < np.sqrt(true) / summary(state).noise < 1.5
    monkeypatch.setattr("pyrt.adaptive._NOISY", np.inf)
    assert np.sqrt(true) / summary(state).noise > 2


def test_the_target_is_reached(renderer):
    assert renderer.render(seed=2, size=SIZE, noise=0.004).stats["noise"] <= 0.004


def bias(name: str, noise: float, seeds: int = 40) -> float:
    """Root mean square over the pixels of the bias of their means, over the mean stated error."""
    results = [scene_renderer(name).render(None, seed, SIZE, noise=noise) for seed in range(seeds)]
    halves = truth(name)
    scale = np.sqrt(halves.mean(axis=0) ** 2 + 0.01)
    first, second = (np.mean([r.image for r in part], axis=0, dtype=float) for part in (results[::2], results[1::2]))
    squared = ((first - halves[0]) / scale * ((second - halves[1]) / scale)).mean()
    return float(np.sqrt(max(squared, 0.0)) / np.mean([result.stats["noise"] for result in results]))


def test_choosing_pixels_biases_them_little():
    assert bias("cornell", 0.005) < 0.15


def test_the_bias_of_pixels_that_judge_themselves_is_seen(monkeypatch):
    let_each_judge_itself(monkeypatch)
    assert bias("cornell", 0.005) > 0.5


# Classes --------------------------------------------------------------------------------------------------------------


def test_statistics_tell_the_samples_of_each_class(renderer):
    result = renderer.render(seed=5, size=SIZE, noise=0.003)
    pixels = result.stats["pixels"]
    assert list(pixels) == ["plain", "edge", "penumbra", "unknown", "light edge"]
    assert not pixels.pop("light edge"), "the light is a point"
    values, counts = np.unique(result.samples, return_counts=True)
    for value, count in zip(values, counts, strict=True):
        assert sum(kind.get(str(value), 0) for kind in pixels.values()) == count
    plain = sum(pixels["plain"].values())
    assert 0.4 < plain / result.samples.size < 0.8
    assert all(pixels.values())
    average = {name: sum(int(n) * k for n, k in kind.items()) / sum(kind.values()) for name, kind in pixels.items()}
    assert average["edge"] > 4 * average["plain"]


def test_edges_of_lights_are_known():
    result = scene_renderer("area light room").render(size=SIZE, noise=0.1)
    bright = result.image.max(axis=2) > 2
    rim = sum(np.roll(bright, step, axis) for step in (-1, 1) for axis in (0, 1)).astype(bool) & ~bright
    edges = sum(result.stats["pixels"]["light edge"].values())
    assert 0.3 * rim.sum() < edges < 2 * rim.sum()
    assert min(map(int, result.stats["pixels"]["light edge"])) >= 32


@pytest.mark.parametrize(("outer", "rim"), [(20.0, True), (90.0, False)])
def test_the_rims_of_spot_lights_are_known(outer, rim):
    """Nothing stands before the lamp, but the picture is not smooth where its cone ends."""
    floor = {"type": "rectangle", "center": [0, 0, 0], "edge1": [20, 0, 0], "edge2": [0, 0, -20], "material_name": "m"}
    spot = {"type": "spot", "position": [0, 4, 0], "look_at": [0, 0, 0], "intensity": [9, 9, 9]}
    scene = {
        "camera": {"position": [0, 6, 0.1], "look_at": [0, 0, 0]},
        "materials": {"m": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}},
        "lights": [{**spot, "inner_angle": outer - 0.1, "outer_angle": outer}],
        "objects": [floor],
    }
    pixels = pyrt.render(scene, size=SIZE, noise=0.1).stats["pixels"]
    assert bool(pixels["penumbra"]) == rim
    assert sum(pixels["plain"].values()) > 0.7 * SIZE[0] * SIZE[1]


def test_without_beams_all_pixels_are_unknown():
    result = pyrt.Renderer(ERROR_SCENES["cornell"](), beams=False).render(size=(16, 16), noise=0.05)
    assert [len(kind) > 0 for kind in result.stats["pixels"].values()] == [False, False, False, True, False]


@pytest.mark.parametrize("name", ["PLAIN", "UNKNOWN"])
def test_without_classes_the_same_error_costs_more(renderer, monkeypatch, name):
    def cost() -> float:
        results = [renderer.render(seed=seed, size=SIZE, noise=0.003) for seed in range(3)]
        return float(np.mean([r.samples.mean() * squared_error(r.image, truth("cornell")) for r in results]))

    with_classes = cost()
    monkeypatch.setattr(Guide, "classify", all_of_class(name))
    assert cost() > 1.2 * with_classes


# Arguments ------------------------------------------------------------------------------------------------------------


def test_spp_limits_a_noise_target_and_the_exit_code_tells(tmp_path):
    arguments = ["render", "example:cornell", "--size", "16x16", "--noise", "1e-6", "-q", "-o", str(tmp_path / "a.png")]
    assert main([*arguments, "--spp", "64"]) == 5
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize("limits", [{"noise": 0.0}, {"noise": float("nan")}, {"time_limit": -1.0}])
def test_limits_must_be_positive(renderer, limits):
    with pytest.raises(pyrt.UsageError, match="expected a number > 0"):
        renderer.render(size=SIZE, **limits)
