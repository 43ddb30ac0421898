"""Snell's law and Fresnel's formulas against float64: everywhere, at the critical angle and without an interface."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrt.layout import constants, dtypes
from tests.device.probe import evaluate
from tests.reference import analytic
from tests.reference.analytic import Array, unit

ULP = 2.0**-23  # of numbers in [1, 2)
OFFSETS = 10.0 ** -np.arange(1, 8)  # rad from the critical angle
ETAS = np.array([1.01, 1 + 1e-6, 1.1, 1.5, 2, 4])


def specular(kind: str, eta: Array, n: Array, d: Array, front: NDArray[Any] | bool = True) -> dict[str, Array]:
    """bsdf_specular for n materials, unit normals (n, 3) on the side of the rays, and directions (n, 3)."""
    material = np.zeros(len(d), dtypes()["Material"])
    material["kind"], material["eta"] = constants()[f"MATERIAL_{kind}"], eta
    code = """
        Surface si;
        si.n = vload3(i, n);
        si.front = front[i];
        Specular s = bsdf_specular(&material[i], &si, vload3(i, d));
        vstore3(s.reflected, i, reflected);
        vstore3(s.refracted, i, refracted);
        reflectance[i] = s.reflectance;
        transmission[i] = s.transmission;
    """
    vector, number = (np.float32, 3), np.float32
    outputs = {"reflected": vector, "refracted": vector, "reflectance": number, "transmission": number}
    sides = np.broadcast_to(front, len(d)).astype(np.int32)
    vectors = {"n": n.astype(np.float32), "d": d.astype(np.float32)}
    out = evaluate("bsdf.h", code, len(d), outputs, material=material, front=sides, **vectors)
    return {name: array.astype(float) for name, array in out.items()}


def random_rays(count: int, seed: int = 0) -> tuple[Array, Array]:
    """Float32 unit normals and directions (count, 3) towards them, at all angles."""
    rng = np.random.default_rng(seed)
    n, d = (unit(rng.normal(size=(count, 3))).astype(np.float32).astype(float) for _ in "nd")
    return np.where((n * d).sum(1, keepdims=True) > 0, -n, n), d


def rays_at(theta: Array) -> tuple[Array, Array]:
    """Normals +z, and directions at the angles."""
    d = np.stack([np.sin(theta), np.zeros_like(theta), -np.cos(theta)], 1).astype(np.float32).astype(float)
    return np.broadcast_to([0.0, 0.0, 1.0], d.shape), d


# Directions -----------------------------------------------------------------------------------------------------------


def condition(eta: Array | float, cos_i: Array, cos_t: Array) -> Array:
    """How much a refracted direction turns where the incoming one turns by one unit."""
    return np.maximum(1, eta) + np.square(eta) * cos_i / cos_t


@pytest.mark.parametrize("eta", [0.25, 1 / 1.5, 0.999999, 1.000001, 1.5, 4])
@pytest.mark.parametrize("front", [True, False])
def test_directions_are_snells(eta, front):
    """As if the incoming direction had been rounded, within 2 ulp."""
    n, d = random_rays(20_000)
    out = specular("REFRACTION", np.full(len(d), eta), n, d, front)
    ratio = float(np.float32(eta) if front else np.float32(1) / np.float32(eta))
    cosine = -(unit(n) * unit(d)).sum(1)
    cos2_t = 1 - ratio**2 * (1 - cosine**2)
    error = np.abs(out["refracted"] - analytic.refract(unit(d), unit(n), ratio)).max(1)
    clear = cos2_t > 1e-6
    assert (error / condition(ratio, cosine, np.sqrt(np.maximum(cos2_t, 1e-6))))[clear].max() < 2 * ULP
    assert np.abs(out["reflected"] - unit(d + 2 * cosine[:, None] * unit(n))).max() < 2 * ULP
    assert (out["reflectance"] == (cos2_t < 0))[np.abs(cos2_t) > 1e-5].all()


@pytest.mark.parametrize("kind", ["REFRACTION", "DIELECTRIC"])
@pytest.mark.parametrize("front", [True, False])
def test_without_an_interface_the_direction_is_bit_equal(kind, front):
    n, d = random_rays(2000)
    d *= 10.0 ** np.random.default_rng(1).uniform(-3, 3, (len(d), 1))
    n[:100], d[:100] = (0, 0, 1), np.where([True, True, False], d[:100], 0)  # exactly along the surface
    out = specular(kind, np.ones(len(d)), n, d, front)
    assert (out["refracted"] == d.astype(np.float32)).all()
    assert (out["reflectance"] == 0).all()
    assert (out["transmission"] == 1).all()


@pytest.mark.parametrize("ior", [1.01, 1.1, 1.5, 2, 4])
def test_a_slab_gives_the_direction_back(ior):
    """In through one side, out through the other."""
    n, d = random_rays(20_000)
    eta = np.full(len(d), 1 / ior)
    inside = specular("DIELECTRIC", eta, n, d)
    out = specular("DIELECTRIC", eta, n, inside["refracted"], front=False)
    error = np.abs(out["refracted"] - unit(d)).max(1)
    amplified = condition(ior, -(n * inside["refracted"]).sum(1), -(n * d).sum(1))
    assert (error / amplified).max() < 4 * ULP
    assert np.abs(inside["transmission"] * out["transmission"] - 1).max() < 4 * ULP


@pytest.mark.parametrize("shape", ["slab", "prism", "ball"])
def test_reversed_paths_return(shape):
    """Turned around behind two surfaces, a ray within 45° of their normals goes back as it came, within 1e-6 rad."""
    n, d = random_rays(20_000)
    rng = np.random.default_rng(1)
    eta = rng.uniform(0.5, 0.95, len(d))
    inside = specular("DIELECTRIC", eta, n, d)["refracted"]
    chord = 2 * (n * inside).sum(1, keepdims=True) * inside - n
    exit_n = {"slab": n, "prism": unit(n + 0.3 * rng.normal(size=n.shape)), "ball": chord}[shape]
    exit_n = np.where((exit_n * inside).sum(1, keepdims=True) > 0, -exit_n, exit_n)
    out = specular("DIELECTRIC", eta, exit_n, inside, front=False)
    back = specular("DIELECTRIC", eta, -exit_n, -out["refracted"])["refracted"]
    home = specular("DIELECTRIC", eta, -n, back, front=False)["refracted"]
    steep = np.minimum(-(exit_n * out["refracted"]).sum(1), -(n * d).sum(1)) > 0.7
    clear = steep & (out["reflectance"] < 1)
    assert clear.mean() > 0.1
    assert np.linalg.norm(home + unit(d), axis=1)[clear].max() < 1e-6


# The critical angle ---------------------------------------------------------------------------------------------------


def cos2_transmitted(eta: Array, cosine: Array, code: str = "y[i] = cos2_transmitted(eta[i], cosine[i]);") -> Array:
    inputs = {"eta": eta.astype(np.float32), "cosine": cosine.astype(np.float32)}
    return evaluate("bsdf.h", code, len(eta), {"y": np.float32}, **inputs)["y"].astype(float)


def critical_cosines() -> tuple[Array, Array, Array]:
    """eta and float32 cosines of angles from the critical one ± 1e-1 to ± 1e-7 rad, and the exact cos²θ_t."""
    eta, offset = (g.ravel() for g in np.meshgrid(ETAS.astype(np.float32).astype(float), np.r_[OFFSETS, -OFFSETS]))
    cosine = np.cos(np.clip(np.arcsin(1 / eta) + offset, 0, np.pi / 2)).astype(np.float32).astype(float)
    p = eta * cosine  # exact: 24 bits times 24
    return eta, cosine, (p - np.sqrt((eta - 1) * (eta + 1))) * (p + np.sqrt((eta - 1) * (eta + 1)))


def test_cosine_at_the_critical_angle_keeps_its_digits():
    eta, cosine, truth = critical_cosines()
    found = cos2_transmitted(eta, cosine)
    clear = np.abs(truth) > 1e-12  # below, float64 has no digits of the truth itself
    assert clear.mean() > 0.9
    assert np.abs(found / truth - 1)[clear].max() < 1e-6
    assert (np.sign(found) == np.sign(truth))[clear].all()


def test_the_plain_formula_loses_them():
    eta, cosine, truth = critical_cosines()
    plain = cos2_transmitted(eta, cosine, "y[i] = 1.0f - eta[i] * eta[i] * (1.0f - cosine[i] * cosine[i]);")
    assert np.abs(plain / truth - 1).max() > 1e-2


def test_critical_angle_gives_numbers():
    theta = np.arcsin(1 / ETAS)[:, None] + np.r_[OFFSETS, 0, -OFFSETS]
    eta = np.broadcast_to(ETAS[:, None], theta.shape).ravel()
    n, d = rays_at(np.clip(theta, 0, np.pi / 2).ravel())
    for kind in ("REFRACTION", "DIELECTRIC"):
        for way, front in ((eta, True), (1 / eta, False)):
            out = specular(kind, way, n, d, front)
            assert all(np.isfinite(value).all() for value in out.values())
            assert ((out["reflectance"] >= 0) & (out["reflectance"] <= 1)).all()
            for direction in ("reflected", "refracted"):
                assert np.abs(np.linalg.norm(out[direction], axis=1) - 1).max() < 2 * ULP


# Fresnel --------------------------------------------------------------------------------------------------------------


def fresnel(eta: Array, cosine: Array) -> Array:
    code = "y[i] = fresnel(eta[i], cosine[i], sqrt1(max1(cos2_transmitted(eta[i], cosine[i]), 0.0f)));"
    return cos2_transmitted(eta, cosine, code)


@pytest.mark.parametrize("eta", [0.25, 1 / 1.5, 0.99, 0.999999, 1.000001, 1.01, 1.5, 4])
def test_fresnel_is_exact(eta):
    """Absolute error of the reflectance, also where it is steep."""
    cosine = np.r_[np.linspace(1e-6, 1, 20_000), 10.0 ** np.linspace(-12, -1, 1000)].astype(np.float32).astype(float)
    etas = np.full(len(cosine), np.float32(eta), float)
    found, truth = fresnel(etas, cosine), analytic.fresnel(cosine, etas)
    assert np.abs(found - truth).max() < 1e-6
    assert found.min() >= 0
    assert found.max() <= 1 + ULP


def test_fresnel_is_the_same_from_both_sides():
    """R(θ_i) from one side is R(θ_t) from the other, whose slope grows like 1 / cosθ_i."""
    cosine = np.linspace(0.01, 1, 10_000).astype(np.float32).astype(float)
    eta = np.full(len(cosine), np.float32(1 / 1.5), float)
    inside = np.sqrt(cos2_transmitted(eta, cosine))
    assert (np.abs(fresnel(eta, cosine) - fresnel(1 / eta, inside)) * cosine).max() < 1e-6


def test_energy_is_conserved():
    """Flux through the interface: the reflected and the transmitted share are one, by the transmission amplitudes."""
    n, d = random_rays(20_000)
    eta = np.full(len(d), 1 / 1.5)
    cos_i = -(unit(n) * unit(d)).sum(1)
    cos_t = np.sqrt(1 - eta**2 * (1 - cos_i**2))
    amplitudes = 2 * eta * cos_i / np.array([eta * cos_i + cos_t, cos_i + eta * cos_t])
    through = cos_t / (eta * cos_i) * (amplitudes**2).mean(0)
    assert np.abs(specular("DIELECTRIC", eta, n, d)["reflectance"] + through - 1).max() < 2e-6
