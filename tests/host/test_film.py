"""The film: exact averages over any number of samples, the same bits however these arrive, and no bad sample."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrt import film as film_module
from pyrt.film import Film
from pyrt.passes import tile_order, tiled_pixels

PIXELS = 5


def film_mean(film: Film) -> NDArray[np.float64]:
    return film_module.mean(film.totals(), film.count)


def film_variance(film: Film) -> NDArray[np.float64]:
    return film_module.variance(film.totals(), film.count)


def random_planes(samples: int, pixels: int = PIXELS, seed: int = 0) -> NDArray[np.float32]:
    """Radiances over many orders of magnitude, so that every rounding shows."""
    rng = np.random.default_rng(seed)
    return np.exp(rng.uniform(-20, 20, (samples, 3, pixels))).astype(np.float32)


def film_of(planes: NDArray[np.float32], *splits: int, first: int = 0) -> Film:
    """Planes added in ranges that end at `splits`; `first` is the index of the first sample."""
    film = Film.empty(planes.shape[2])
    ends = [*splits, len(planes)]
    for start, end in zip([0, *splits], ends, strict=True):
        film.add(planes[start:end], 0, first + start)
    return film


def assert_same_bits(a: Film, b: Film) -> None:
    assert (film_mean(a) == film_mean(b)).all()
    assert (film_variance(a) == film_variance(b)).all()
    assert (a.count == b.count).all()
    assert a.dropped == b.dropped


# Values ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [1, 2, 3, 32, 100, 1000])
def test_mean_and_variance(samples):
    planes = random_planes(samples)
    film, x = film_of(planes), planes.astype(float)
    np.testing.assert_allclose(film_mean(film), x.mean(0), rtol=1e-14)
    truth = x.var(0, ddof=1) / samples if samples > 1 else np.zeros((3, PIXELS))
    np.testing.assert_allclose(film_variance(film), truth, rtol=1e-11)
    assert (film.count == samples).all()
    assert film.dropped == 0


def test_no_samples():
    film = Film.empty(3)
    assert (film_mean(film) == 0).all()
    assert (film_variance(film) == 0).all()


def test_long_images_are_summed_in_blocks():
    planes = random_planes(3, pixels=40_000)
    np.testing.assert_allclose(film_mean(film_of(planes)), planes.astype(float).mean(0), rtol=1e-15)


RAMPS = {"constant": np.full(1, 0.1, np.float32), "ramp": np.linspace(0, 2, 1 << 20, dtype=np.float32)}


def errors_of_1e8_samples(image: str) -> float:
    """N25: error of the mean, relative, or of the samples' variance, relative to the squared mean, if that is larger.

    The 2^20 samples are given 95 times, as if rendered with later and later indices.
    """
    ramp, samples = RAMPS[image], 1 << 20
    film = part = film_of(np.broadcast_to(ramp[:, None, None], (samples, 3, 1)))
    for index in range(1, 95):
        film = film.merge(Film(part.count, {0: {(20, index): part.strips[0][20, 0]}}))
    truth = ramp.astype(float)
    spread = film_variance(film) * (film.count - 1.0)
    return max(np.abs(film_mean(film) / truth.mean() - 1).max(), np.abs(spread - truth.var()).max() / truth.mean() ** 2)


@pytest.mark.parametrize("image", RAMPS)
def test_1e8_samples(image):
    assert errors_of_1e8_samples(image) < 1e-13


class SinglePrecision:
    """numpy, where arrays whose type is not named are of float32."""

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)

    def empty(self, shape: Any, dtype: Any = np.float32) -> NDArray[Any]:
        return np.empty(shape, dtype)

    def zeros(self, shape: Any, dtype: Any = np.float32) -> NDArray[Any]:
        return np.zeros(shape, dtype)


def running_sums(run: NDArray[np.float32], sums: NDArray[Any], scratch: NDArray[Any]) -> None:
    """In place of the tree: one sample after the other."""
    sums[0] = np.cumsum(run, axis=0, dtype=sums.dtype)[-1]
    sums[1] = np.cumsum(run * run, axis=0, dtype=sums.dtype)[-1]


@pytest.mark.parametrize("image", RAMPS)
@pytest.mark.parametrize(("tree", "least"), [(True, 1e-8), (False, 1e-6)])
def test_1e8_samples_in_float32_are_noticed(image, tree, least, monkeypatch):
    """N28: the film itself with sums in float32. The tree alone saves seven digits; without it, N25's six are lost."""
    monkeypatch.setattr(film_module, "np", SinglePrecision())
    if not tree:
        monkeypatch.setattr(film_module, "_tree_sums", running_sums)
    assert errors_of_1e8_samples(image) > least


# Order ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [7, 64, 100])
def test_passes_change_no_bit(samples):
    planes = random_planes(samples)
    whole = film_of(planes)
    rng = np.random.default_rng(1)
    for _ in range(50):
        splits = np.unique(rng.integers(1, samples, rng.integers(1, samples))).tolist()
        assert_same_bits(whole, film_of(planes, *splits))


@pytest.mark.parametrize("samples", [7, 64, 100])
def test_merged_halves_change_no_bit(samples):
    planes = random_planes(samples)
    whole = film_of(planes)
    for k in range(1, samples):
        first, second = film_of(planes[:k]), film_of(planes[k:], first=k)
        assert_same_bits(whole, first.merge(second))
        assert_same_bits(whole, second.merge(first))


def test_three_parts_merge_in_any_order():
    planes = random_planes(100)
    a, b, c = film_of(planes[:13]), film_of(planes[13:70], first=13), film_of(planes[70:], first=70)
    assert_same_bits(film_of(planes), c.merge(a).merge(b))


def test_running_sums_would_differ():
    """What the tree protects from: sums of halves are not the sum of the whole."""
    x = random_planes(100).astype(float)
    halves = np.cumsum(x[:37], axis=0)[-1] + np.cumsum(x[37:], axis=0)[-1]
    assert (halves != np.cumsum(x, axis=0)[-1]).any()


@pytest.mark.parametrize("cuts", [[0, 24, 40], [0, 8, 16, 24, 32, 40], [0, 5, 33, 40], [0, 40]])
@pytest.mark.parametrize("others", [[0, 24, 40], [0, 16, 24, 32, 40], [0, 1, 40]])
def test_films_in_other_strips_merge(cuts, others):
    """Whatever the strips, they have the nodes of the whole; and neither film changes."""
    planes = random_planes(12, pixels=40)

    def in_strips(first: int, end: int, edges: list[int]) -> Film:
        film = Film.empty(40)
        for low, high in pairwise(edges):
            film.add(planes[first:end, :, low:high], low, first)
        return film

    a, b = in_strips(0, 5, cuts), in_strips(5, 12, others)
    before = [copy.deepcopy(film) for film in (a, b)]
    assert_same_bits(a.merge(b), film_of(planes))
    assert_same_bits(b.merge(a), film_of(planes))
    for film, old in zip((a, b), before, strict=True):
        assert_same_bits(film, old)
    assert_same_bits(a.merge(b, reuse=True), film_of(planes))
    assert_same_bits(a, before[0])
    assert_same_bits(a.merge(Film.empty(40)), a)
    assert_same_bits(Film.empty(40).merge(a), a)


def test_strips_of_pixels_are_independent():
    planes = random_planes(24, pixels=11)
    film = Film.empty(11)
    for samples in (slice(0, 10), slice(10, 24)):
        for pixels in (slice(4, 11), slice(0, 4)):
            film.add(planes[samples, :, pixels], pixels.start, samples.start)
    assert_same_bits(film, film_of(planes))
    assert_same_bits(film.merge(film_of(planes, first=24)), film_of(np.concatenate([planes, planes])))


# Bad samples ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_dropped_and_counted(bad):
    planes = random_planes(40)
    planes[7, 1, 2] = planes[8, 0, 2] = planes[30, :, 4] = bad
    film = film_of(planes, 5, 25)
    assert film.dropped == 3
    assert film.count.tolist() == [40, 40, 38, 40, 39]
    kept = np.delete(planes[:, :, 2], [7, 8], axis=0).astype(float)
    np.testing.assert_allclose(film_mean(film)[:, 2], kept.mean(0), rtol=1e-14)
    np.testing.assert_allclose(film_variance(film)[:, 2], kept.var(0, ddof=1) / 38, rtol=1e-11)
    assert np.isfinite(film_mean(film)).all()
    assert_same_bits(film, film_of(planes))


def test_a_pixel_without_any_good_sample_is_black():
    film = film_of(np.full((9, 3, 1), np.nan, np.float32))
    assert film.dropped == 9
    assert film.count[0] == 0
    assert (film_mean(film) == 0).all()
    assert (film_variance(film) == 0).all()


def test_the_largest_floats_stay_finite():
    film = film_of(np.full((1000, 3, 1), np.finfo(np.float32).max))
    assert film.dropped == 0
    np.testing.assert_allclose(film_mean(film), np.finfo(np.float32).max, rtol=1e-15)


# Pictures -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("width", "height"), [(1, 1), (8, 4), (7, 9), (160, 120)])
def test_a_picture_has_each_pixel_in_its_place(width, height):
    """Also where tiles are cut off by the picture's edge, and with more pixels than one block of the sums."""
    pixels = tiled_pixels(width, height)
    film = film_of(random_planes(3, len(pixels)))
    image, variance, samples = film_module.picture(
        film.totals(), film.count, tile_order(width, height), (height, width)
    )
    truth = np.full((height, width, 3), np.nan, np.float32)
    truth[pixels >> 16, pixels & 0xFFFF] = film_mean(film).T
    np.testing.assert_array_equal(image, truth)
    truth[pixels >> 16, pixels & 0xFFFF] = film_variance(film).T
    np.testing.assert_array_equal(variance, truth)
    assert (samples == 3).all()
    assert samples.shape == (height, width)


def test_pixels_come_tile_by_tile():
    tile = tiled_pixels(8, 8)[:16]
    assert (tile >> 16).max() == (tile & 0xFFFF).max() == 3
    assert len(np.unique(tiled_pixels(7, 9))) == 63
