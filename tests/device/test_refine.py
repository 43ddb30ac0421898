"""Adding samples to an adaptive render: the kernel against numpy, bit by bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrt import load_scene
from pyrt.adaptive import RADIANCE_FLOOR, STEADY_LEVEL, add
from pyrt.device import Device
from pyrt.features import build_options, feature_table
from pyrt.film import Film
from pyrt.guide import Guide
from pyrt.layout import constants, dtypes
from pyrt.partial import Adaptive
from pyrt.passes import Traced

PIXELS = 150
PAD = 16


@pytest.fixture(scope="module")
def guide() -> Guide:
    device = Device()
    if not device.has_double:
        pytest.skip("the device has no float64")
    options = [*build_options(feature_table(load_scene("example:cornell"))), "-DHAS_DOUBLE=1"]
    return Guide.of(device, device.build("adaptive.cl", options), {}, None, (10, 15))


def state_of(pixels: int) -> Adaptive:
    state = Adaptive.empty(pixels)
    state.classes[:] = np.arange(pixels) % constants()["PIXEL_CLASSES"]
    return state


def traced(guide: Guide, samples: NDArray[np.float32], first: int, places: NDArray[Any]) -> Traced:
    params = np.zeros((), dtypes()["PassParams"])
    params["pixel_count"], params["sample_count"] = samples.shape[2], samples.shape[0]
    params["first_sample"], params["stride"] = first, samples.shape[2] + PAD
    planes = np.zeros((*samples.shape[:2], samples.shape[2] + PAD), np.float32)
    planes[..., : samples.shape[2]] = samples
    upload = guide.device.upload
    return Traced(params, upload("planes", planes), upload("places", places.astype(np.uint32)))


@pytest.mark.parametrize("broken", [False, True])
def test_the_kernel_adds_what_numpy_adds(guide, broken):
    """First 2 samples of all pixels, then 8, 16 and 64 of some, in no order."""
    random = np.random.default_rng(3)
    by_kernel, by_numpy = state_of(PIXELS), state_of(PIXELS)
    for first, end, pixels in ((0, 2, PIXELS), (2, 8, 77), (8, 16, 61), (16, 64, 9), (64, 128, 1)):
        fits = np.flatnonzero(by_numpy.level == max(first.bit_length() - 1, 0))
        done = random.permutation(fits)[:pixels]
        samples = random.lognormal(size=(end - first, 3, len(done))).astype(np.float32)
        if broken:
            samples.flat[:: 1 + samples.size // 7] = np.nan
        film = Film.empty(len(done))
        film.add(samples, 0, first)
        by_kernel.wanted[done] = by_numpy.wanted[done] = end.bit_length() - 1
        add(by_numpy, done, film)
        guide.refine(traced(guide, samples, first, done), by_kernel, STEADY_LEVEL, RADIANCE_FLOOR)
    for name in ("sums", "error", "level", "count", "dropped", "torn"):
        np.testing.assert_array_equal(getattr(by_kernel, name), getattr(by_numpy, name))
    np.testing.assert_allclose(by_kernel.falls, by_numpy.falls, rtol=1e-12)
    assert (by_kernel.dropped > 0) == broken
    assert by_kernel.level.max() == 7
