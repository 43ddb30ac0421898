"""The rays' way to the device: whatever their type, order or number, and with or without float64 there."""

from __future__ import annotations

import warnings
from unittest.mock import patch

import numpy as np
import pytest

import pyrt
from pyrt.device import Device
from pyrt.rays import localise, make_rays
from tests import meshes
from tests.meshes import Floats

EXTREMES = np.array([0.0, -0.0, 1.0, 5e-324, 1e-310, -1e-38, 1e-30, 1e8, -1e29, 3e38, 1e300, -1e308, np.nan, np.inf])


def without_double(*mesh: Floats) -> pyrt.RayTracer:
    with patch.object(Device, "has_double", False):
        return pyrt.RayTracer(*mesh)


def bits(hits: pyrt.Hits) -> list[bytes | int]:
    return [hits.t.tobytes(), hits.triangle.tobytes(), hits.u.tobytes(), hits.v.tobytes(), hits.invalid]


def mesh_and_rays(seed: int, count: int) -> tuple[tuple[Floats, Floats], Floats, Floats, Floats]:
    """A soup of some size, and rays of which some are far away, extreme, or not finite."""
    random = np.random.default_rng(seed)
    size = 10.0 ** random.choice([-250, -30, -3, 0, 3, 28])

    def numbers(*shape: int) -> Floats:
        usual = random.uniform(-size, size, shape) * 10.0 ** random.choice([0, 0, 0, 0, 2, 9], shape)
        return np.where(random.random(shape) < 0.03, random.choice(EXTREMES, shape), usual)

    mesh = meshes.soup(random.uniform(-size, size, (60, 3, 3)))
    return mesh, numbers(count, 3), numbers(count, 3), random.uniform(0, 4, count)


@pytest.mark.parametrize("seed", range(6))
def test_kernel_and_numpy_normalise_to_the_same_bits(seed):
    mesh, origins, directions, t_max = mesh_and_rays(seed, 5000)
    with_double, host = pyrt.RayTracer(*mesh), without_double(*mesh)
    if not with_double._double:
        pytest.skip("the device has no float64")
    for limit in (np.inf, t_max):
        hits = with_double.closest(origins, directions, limit)
        assert (hits.triangle >= 0).sum() > 100
        assert hits.invalid > 100
        assert bits(hits) == bits(host.closest(origins, directions, limit))
        hidden = with_double.occluded(origins, directions, limit)
        assert np.array_equal(hidden, host.occluded(origins, directions, limit))
        assert np.array_equal(hidden, hits.triangle >= 0)


@pytest.mark.parametrize("size", [1.0, 1e-160])
def test_packets_change_nothing(size):
    """A ray among rays that are not finite is loaded alone; one among its like may be loaded in vectors."""
    random = np.random.default_rng(3)
    tracer = pyrt.RayTracer(*meshes.soup(random.uniform(-size, size, (60, 3, 3))))
    origins, directions = random.uniform(-size, size, (2, 803, 3))
    directions *= 2.0 ** np.repeat(random.choice([0.0, -300.0, 499.0, 501.0], 101), 8)[:803, None]
    for limit in (np.full(803, np.inf), random.uniform(0, 2 * size, 803) / np.abs(directions).max(axis=1)):
        slots = 8 * np.arange(803) + random.integers(8, size=803)
        scattered = np.full((8 * 803, 6), np.nan)
        scattered[slots] = np.concatenate([origins, directions], axis=1)
        alone = scattered[:, :3], scattered[:, 3:], np.repeat(limit, 8)
        together, apart = tracer.closest(origins, directions, limit), tracer.closest(*alone)
        assert (together.triangle >= 0).sum() > 100
        for name in ("t", "triangle", "u", "v"):
            assert getattr(together, name).tobytes() == getattr(apart, name)[slots].tobytes()
        for hidden in (tracer.occluded(origins, directions, limit), tracer.occluded(*alone)[slots]):
            assert np.array_equal(hidden, together.triangle >= 0)


def test_devices_without_packets_find_the_same_bits():
    random = np.random.default_rng(4)
    mesh = meshes.soup(random.uniform(-1, 1, (60, 3, 3)))
    packets = pyrt.RayTracer(*mesh)
    with patch.object(Device, "packet", 1):
        single = pyrt.RayTracer(*mesh)
        origins, directions = random.uniform(-1, 1, (2, 1003, 3))
        directions[500:] = directions[500] + 0.1 * directions[500:]  # run together
        alone = single.closest(origins, directions), single.occluded(origins, directions)
        listed = single.all_hits(origins, directions)
    assert bits(packets.closest(origins, directions)) == bits(alone[0])
    assert np.array_equal(packets.occluded(origins, directions), alone[1])
    assert np.array_equal(packets.all_hits(origins, directions).triangle, listed.triangle)


def test_another_rounding_is_seen():
    """The control: origins rounded to float32 before they are normalised give other hits."""
    mesh, origins, directions, _ = mesh_and_rays(2, 5000)
    with np.errstate(over="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rounded = origins.astype(np.float32)
    assert bits(without_double(*mesh).closest(rounded, directions)) != bits(
        pyrt.RayTracer(*mesh).closest(origins, directions)
    )


def test_any_type_and_order_of_rays():
    random = np.random.default_rng(0)
    tracer = pyrt.RayTracer(*meshes.cube())
    origins, directions = random.integers(-3, 4, (2, 500, 3)).astype(float)
    directions[:, 0] = 1.0
    origins.flags.writeable = False
    expected = bits(tracer.closest(origins, directions, 2.0))
    for o, d, limit in (
        (np.asfortranarray(origins), directions[::-1][::-1], [2.0]),
        (origins.astype(np.float32), directions.astype(np.int8), np.full(500, 2, np.uint8)),
        (np.repeat(origins, 2, axis=0)[::2], directions.tolist(), np.float32(2.0)),
    ):
        assert bits(tracer.closest(o, d, limit)) == expected


@pytest.mark.parametrize("size", [1, 37, 399])
def test_batches_change_nothing(size):
    mesh, origins, directions, t_max = mesh_and_rays(1, 400 if size > 1 else 3)
    for tracer in (pyrt.RayTracer(*mesh), without_double(*mesh)):
        for limit in (1.5, t_max):
            expected, hidden = tracer.closest(origins, directions, limit), tracer.occluded(origins, directions, limit)
            with patch("pyrt.rays.BATCH", size):
                assert bits(tracer.closest(origins, directions, limit)) == bits(expected)
                assert np.array_equal(tracer.occluded(origins, directions, limit), hidden)


def test_no_rays():
    hits = pyrt.RayTracer(*meshes.cube()).closest(np.zeros((0, 3)), np.zeros((0, 3)))
    assert [a.shape for a in (hits.t, hits.triangle, hits.u, hits.v)] == [(0,)] * 4


@pytest.mark.parametrize(
    ("origins", "directions", "t_max", "message"),
    [
        (np.zeros(3), np.ones((1, 3)), 1.0, r"origins: expected an array of shape \(n, 3\), got \(3,\)"),
        (np.zeros((2, 3)), np.ones((1, 3)), 1.0, r"directions: expected as many as origins \(2\), got 1"),
        (np.zeros((2, 3)), np.ones((2, 3)), [1.0] * 3, r"t_max: expected a number or 2 of them, got float64 \(3,\)"),
        (np.zeros((1, 3), complex), np.ones((1, 3)), 1.0, r"origins: expected real numbers, got complex128"),
    ],
)
def test_what_does_not_fit_is_refused(origins, directions, t_max, message):
    with pytest.raises(pyrt.UsageError, match=message):
        pyrt.RayTracer(*meshes.cube()).closest(origins, directions, t_max)


def test_localised_directions_have_a_largest_component_between_a_half_and_one():
    mesh, origins, directions, _ = mesh_and_rays(0, 1000)
    tracer = pyrt.RayTracer(*mesh)
    local = localise(next(iter(make_rays(origins, directions, np.inf).batches()))[1], tracer._space, tracer._bound)
    largest = np.abs(local.rays.directions).max(axis=1)
    assert ((largest >= 0.5) & (largest <= 1.0)).all()
