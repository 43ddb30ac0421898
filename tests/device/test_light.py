"""Light samplers against closed forms: no bias at any solid angle, nothing negative, the densities that they state."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrt.layout import constants, dtypes
from pyrt.pack import pack_scene
from pyrt.scene import Scene, SpotLight
from tests.device.probe import evaluate, sobol_points
from tests.reference import analytic
from tests.reference.analytic import Array, dot, unit
from tests.reference.statistics import gaussian, replicate, threshold, z_scores

SOLID_ANGLES = [1.0, 1e-3, 1e-6, 1e-9]
BIAS = 1e-5
CALLS = {
    "point": "point_sample(&light[0], &si)",
    "rectangle": "rectangle_sample(&light[0], &si, u)",
    "mesh": "mesh_sample(&scene, &light[0], &si, u, pick[i % grid[0]])",
    "sphere": "sphere_light_sample(&light[0], &si, u)",
}


def sample(kind: str, lights: dict[str, NDArray[Any]], p: Array, n: Array, u: Array, pick: Any = 0) -> dict[str, Array]:
    """Irradiance (receivers, k) and end of the shadow ray (receivers, k, 3) for points and unit normals (receivers, 3)
    and k random numbers at each: u (k, 2), the same for all, or u (receivers, k, 2); pick (k,). Of several lights,
    receiver i sees row i."""
    count, k = len(p), u.shape[-2]
    code = f"""
        uint r = i / grid[0];
        float2 u = vload2(i % grid[2], us);
        Surface si;
        si.p = vload3(r, p);
        si.n = si.ng = vload3(r, n);
        Scene scene = {{0}};
        scene.triangles = triangles;
        scene.cdf = cdf;
        const global Light *light = lights + (grid[1] ? r : 0u);
        LightSample s = {CALLS[kind]};
        irradiance[i] = s.irradiance.x;
        vstore3(s.q, i, q);
    """
    inputs = {"lights": lights["light"], "triangles": np.zeros(1, dtypes()["Triangle"]), "cdf": np.zeros(1, np.uint32)}
    out = evaluate(
        "light.h",
        code,
        count * k,
        {"irradiance": np.float32, "q": (np.float32, 3)},
        **{**inputs, **{name: lights[name] for name in ("triangles", "cdf") if name in lights}},
        grid=np.array([k, len(lights["light"]) > 1, u.size // 2], np.uint32),
        pick=np.broadcast_to(np.asarray(pick, np.uint32), k),
        us=np.minimum(u, 1 - 2.0**-24).astype(np.float32),
        p=p.astype(np.float32),
        n=n.astype(np.float32),
    )
    return {"irradiance": out["irradiance"].reshape(count, k).astype(float), "q": out["q"].reshape(count, k, 3)}


def float32(x: Array) -> Array:
    """Rounded as the device sees it."""
    return np.asarray(x, np.float32).astype(float)


def gauss(order: int) -> tuple[Array, Array]:
    """Nodes (order², 2) and weights of Gauss and Legendre's rule on the unit square."""
    x, w = np.polynomial.legendre.leggauss(order)
    x, w = (x + 1) / 2, w / 2
    return np.stack(np.meshgrid(x, x), -1).reshape(-1, 2), np.outer(w, w).ravel()


def random_u(count: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).random((count, 2))


def random_units(count: int, rng: np.random.Generator) -> Array:
    return float32(unit(rng.normal(size=(count, 3))))


def light_rows(kind: str, count: int = 1) -> NDArray[Any]:
    rows = np.zeros(count, dtypes()["Light"])
    rows["kind"], rows["emission"] = constants()[f"LIGHT_{kind}"], 1
    return rows


def assert_unbiased(found: Array, truth: Array, bias: float = BIAS) -> None:
    """Over the receivers the relative error averages to nothing: |mean| < bias even with 4 standard errors added."""
    error = found / truth - 1
    assert abs(error.mean()) + 4 * error.std() / np.sqrt(error.size) < bias


# Points ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [1e-6, 1e-3, 1.0])
def test_point_light_is_the_inverse_square_law(distance):
    """Within 2e-6 at every point, once the rounding of the place is taken out: places are multiples of 2^-30."""
    rng = np.random.default_rng(0)
    to = np.round(distance * random_units(20_000, rng) * 2.0**30) / 2.0**30
    to, n = float32(to), random_units(20_000, rng)
    rows = light_rows("POINT")
    found = sample("point", {"light": rows}, -to, n, np.zeros((1, 2)))["irradiance"][:, 0]
    truth = np.maximum(dot(unit(n), to), 0) / dot(to, to) ** 1.5
    assert (found >= 0).all()
    clear = truth * dot(to, to) > 0.1  # nearer to the horizon the rounding of the normal counts for more
    assert np.abs(found[clear] / truth[clear] - 1).max() < 2e-6


@pytest.mark.parametrize("inner", [0, 0.5, 0.99])
@pytest.mark.parametrize("outer", [0.01, 1, 30, 90])
def test_spot_light_fades_between_its_angles(inner, outer):
    """((cos − cos outer) / (cos inner − cos outer))² by its angles in float64, up to the rounding of directions."""
    rng = np.random.default_rng(0)
    inner *= outer
    angles = np.concatenate([[0, inner, outer, 180], rng.uniform(0, min(1.5 * outer, 180), 2000)])
    axis, sideways = np.array([0.6, 0, 0.8]), np.array([0.8, 0, -0.6])
    to = np.cos(np.radians(angles))[:, None] * -axis + np.sin(np.radians(angles))[:, None] * -sideways
    light = SpotLight((0, 0, 0), tuple(axis), (1, 1, 1), inner, outer)
    rows = pack_scene(Scene(lights=(light,))).arrays["lights"]
    found = sample("point", {"light": rows}, -to, to, np.zeros((1, 2)))["irradiance"][:, 0]
    versine, versine_inner, versine_outer = (2 * np.sin(np.radians(a) / 2) ** 2 for a in (angles, inner, outer))
    truth = np.clip((versine_outer - versine) / (versine_outer - versine_inner), 0, 1) ** 2
    rounding = 1e-6 + 8e-7 / np.radians(outer) / (1 - (inner / outer) ** 2)
    np.testing.assert_allclose(found, truth, rtol=0, atol=rounding)
    assert rounding < 0.25
    assert (found == 0).any()
    assert found.max() > 0.99


# Rectangles -----------------------------------------------------------------------------------------------------------


def rectangles(p: Array, directions: Array, normals: Array, omega: float, distance: float = 1) -> NDArray[Any]:
    """Light rows: one rectangle for each point p, seen in the direction under about omega sr if it faced p."""
    count = len(p)
    rows = light_rows("RECTANGLE", count)
    helper = np.where(np.abs(normals[:, :1]) < 0.6, [(1.0, 0, 0)], [(0, 1.0, 0)])
    e1 = unit(np.cross(helper, normals)) * distance * np.sqrt(omega)
    e2 = np.cross(normals, e1) * 0.7
    rows["edge1"], rows["edge2"] = e1, e2
    rows["position"] = p + distance * directions - e1 / 2 - e2 / 2
    e1, e2 = rows["edge1"].astype(float), rows["edge2"].astype(float)
    rows["n"], rows["area"] = unit(np.cross(e1, e2)), np.linalg.norm(np.cross(e1, e2), axis=1)
    return rows


def rectangle_corners(rows: NDArray[Any]) -> Array:
    corner, e1, e2 = (rows[name].astype(float) for name in ("position", "edge1", "edge2"))
    return np.stack([corner, corner + e1, corner + e1 + e2, corner + e2], 1)


def rectangle_irradiance(rows: NDArray[Any], p: Array, n: Array) -> Array:
    """Area integral in float64: Lambert's formula loses its digits to cancellation at small solid angles."""
    u, weight = gauss(48)
    corner, e1, e2 = (rows[name].astype(float)[:, None] for name in ("position", "edge1", "edge2"))
    to = corner + u[:, :1] * e1 + u[:, 1:] * e2 - p[:, None]
    normal = np.cross(e1, e2)
    patch = np.maximum(dot(to, n[:, None]), 0) * np.maximum(-dot(to, normal), 0) / dot(to, to) ** 2
    return patch @ weight


def facing_setup(omega: float, count: int = 400, grazing: float | None = None) -> tuple[NDArray[Any], Array, Array]:
    """Rectangles that lie wholly above the horizons of points p with normals n, at many angles."""
    rng = np.random.default_rng(int(1 / omega))
    p, d = float32(rng.uniform(-0.5, 0.5, (count, 3))), random_units(count, rng)
    rows = rectangles(p, d, unit(-d + 0.4 * rng.uniform(-1, 1, (count, 3))), omega, 0.25)
    n = random_units(count, rng)
    n = np.where(dot(n, d)[:, None] < 0, -n, n)
    if grazing is not None:
        n = float32(unit(n + d * ((grazing - dot(n, d)) / dot(d, d))[:, None]))
    above = (dot(rectangle_corners(rows) - p[:, None], n[:, None]) > 0).all(1)
    return rows[above], p[above], n[above]


@pytest.mark.parametrize("omega", SOLID_ANGLES)
def test_rectangle_is_unbiased(omega):
    rows, p, n = facing_setup(omega)
    u, weight = gauss(24)
    found = sample("rectangle", {"light": rows}, p, n, u)["irradiance"] @ weight
    truth = rectangle_irradiance(rows, p, n)
    if omega >= 1e-3:
        np.testing.assert_allclose(truth, lamberts(rows, p, n), rtol=1e-8)
    assert_unbiased(found, truth)
    assert np.abs(found / truth - 1).max() < 1e-4


def lamberts(rows: NDArray[Any], p: Array, n: Array) -> Array:
    corners = rectangle_corners(rows)
    return np.concatenate([analytic.polygon_irradiance(p[i : i + 1], n[i : i + 1], corners[i]) for i in range(len(p))])


@pytest.mark.parametrize(("count", "bias"), [(20_000, 1e-6), pytest.param(200_000, 2e-7, marks=pytest.mark.slow)])
@pytest.mark.parametrize("grazing", [1e-2, 1e-3])
@pytest.mark.parametrize("omega", [1e-6, 1e-9])
def test_rectangle_at_grazing_receivers(omega, grazing, count, bias):
    """The cosine of a single point has the rounding of the place; over many points it averages out, far below BIAS."""
    rows, p, n = facing_setup(omega, count, grazing)
    u, weight = gauss(3)
    found = sample("rectangle", {"light": rows}, p, n, u)["irradiance"] @ weight
    truth = rectangle_irradiance_small(rows, p, n)
    assert_unbiased(found, truth, bias)
    with pytest.raises(AssertionError):
        assert_unbiased(found * (1 + bias), truth, bias)
    assert np.abs(found / truth - 1).max() < 5e-7 / grazing


def rectangle_irradiance_small(rows: NDArray[Any], p: Array, n: Array) -> Array:
    """The same area integral by 2 × 2 points, enough for solid angles below 1e-6 sr."""
    u, weight = gauss(2)
    corner, e1, e2 = (rows[name].astype(float)[:, None] for name in ("position", "edge1", "edge2"))
    to = corner + u[:, :1] * e1 + u[:, 1:] * e2 - p[:, None]
    return (np.maximum(dot(to, n[:, None]), 0) * np.maximum(-dot(to, np.cross(e1, e2)), 0) / dot(to, to) ** 2) @ weight


def test_rectangle_through_the_horizon():
    """Only what is above the horizon counts: Lambert's formula of the clipped polygon, in replicates over random u."""
    rng = np.random.default_rng(3)
    p, d = float32(rng.uniform(-0.5, 0.5, (64, 3))), random_units(64, rng)
    rows = rectangles(p, d, -d, 1.0, 0.25)
    n = float32(unit(np.cross(d, rng.normal(size=d.shape)) + 0.2 * d))
    found = sample("rectangle", {"light": rows}, p, n, random_u(1 << 14))["irradiance"]
    assert (found >= 0).all()
    replicates = found.reshape(64, 64, -1).mean(2).T
    scores = gaussian(z_scores(replicate(replicates), lamberts(rows, p, n)), 63)
    assert np.abs(scores).max() < threshold(scores.size)


def test_rectangle_is_dark_behind_and_below():
    rng = np.random.default_rng(4)
    p, d = float32(rng.uniform(-0.5, 0.5, (200, 3))), random_units(200, rng)
    behind = rectangles(p, d, d, 0.1, 0.25)
    below = rectangles(p, d, -d, 0.1, 0.25)
    assert (sample("rectangle", {"light": behind}, p, d, random_u(64))["irradiance"] == 0).all()
    assert (sample("rectangle", {"light": below}, p, -d, random_u(64))["irradiance"] == 0).all()


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9, 1e-12, 1e-20])
@pytest.mark.parametrize("size", [0.5, 1e-6])
def test_rectangle_next_to_its_corner(gap, size):
    """Points beside, before and on the lamp, as near as floats can be: finite, not negative, and on the lamp."""
    rows = light_rows("RECTANGLE")
    rows["edge1"], rows["edge2"], rows["n"], rows["area"] = (size, 0, 0), (0, size, 0), (0, 0, 1), size * size
    p = gap * np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], float)
    for n in ((0, 0, -1), (1, 0, 0), (0.6, 0, 0.8), (-0.6, 0, -0.8)):
        u = np.concatenate([random_u(200), [(0, 0), (0, 1), (1, 0), (1, 1)]])
        out = sample("rectangle", {"light": rows}, p, np.broadcast_to(np.array(n, float), p.shape), u)
        assert np.isfinite(out["irradiance"]).all()
        assert (out["irradiance"] >= 0).all()
        lit = out["irradiance"] > 0
        assert (p[:, 2][lit.any(1)] > 0).all()
        on_lamp = out["q"][lit][:, :2] / size  # but for the rounding of where the horizon cuts it
        assert ((on_lamp >= 0) & (on_lamp < 1 + 1e-6)).all()


@pytest.mark.parametrize(("gap", "bias"), [(1e-1, BIAS), (1e-3, BIAS), (1e-5, BIAS), (1e-7, 3e-4)])
def test_rectangle_in_a_wall_next_to_the_floor(gap, bias):
    """Points of a floor ever closer to the edge that it shares with the lamp: no sample counts for more than 2π.

    At 1e-7 the gap is as small as the rounding of places on the lamp.
    """
    rows = light_rows("RECTANGLE")
    rows["edge1"], rows["edge2"], rows["n"], rows["area"] = (0, 0.5, 0), (0, 0, 0.5), (1, 0, 0), 0.25
    p, n = float32(np.array([(gap, 0.2, 0.0)])), np.array([(0.0, 0.0, 1.0)])
    u = sobol_points(np.arange(16, dtype=np.uint32), 0, 1 << 16).reshape(-1, 2)
    found = sample("rectangle", {"light": rows}, p, n, u)["irradiance"][0]
    assert abs(found.mean() / lamberts(rows, p, n)[0] - 1) < bias
    assert found.max() < 2 * np.pi


# Form factors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", ["parallel", "perpendicular"])
def test_form_factors(case):
    """Unit squares: the mean irradiance over one from the other is π F."""
    rows = light_rows("RECTANGLE")
    rows["area"] = 1
    if case == "parallel":
        rows["position"], rows["edge1"], rows["edge2"], rows["n"] = (0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, -1)
        truth = analytic.FORM_FACTOR_PARALLEL
    else:
        rows["edge1"], rows["edge2"], rows["n"] = (0, 1, 0), (0, 0, 1), (1, 0, 0)
        truth = analytic.FORM_FACTOR_PERPENDICULAR
    pixels = np.arange(16, dtype=np.uint32)
    places, u = sobol_points(pixels, 0, 1 << 18), sobol_points(pixels, 1, 1 << 18)
    p = np.concatenate([places, np.zeros_like(places[..., :1])], 2).reshape(-1, 3)
    n = np.broadcast_to([0.0, 0.0, 1.0], p.shape)
    found = sample("rectangle", {"light": rows}, p, n, u.reshape(-1, 1, 2))["irradiance"]
    estimate = replicate(found.reshape(16, -1).mean(1) / np.pi)
    assert abs(estimate.mean - truth) < min(3 * np.sqrt(estimate.variance) + 5e-8, 1e-4)


# Meshes ---------------------------------------------------------------------------------------------------------------


def mesh_light(corners: Array) -> dict[str, NDArray[Any]]:
    """Arrays of an emitter of triangles (m, 3, 3)."""
    triangles = np.zeros(len(corners), dtypes()["Triangle"])
    triangles["v0"], triangles["e1"] = corners[:, 0], corners[:, 1] - corners[:, 0]
    triangles["e2"] = corners[:, 2] - corners[:, 0]
    normal = np.cross(triangles["e1"].astype(float), triangles["e2"].astype(float))
    triangles["n"] = unit(normal)
    area = np.linalg.norm(normal, axis=1)
    rows = light_rows("MESH")
    rows["count"] = len(corners)
    cdf = np.minimum(np.round(np.cumsum(area) / area.sum() * 2.0**32), 2.0**32 - 1).astype(np.uint32)
    return {"light": rows, "triangles": triangles, "cdf": cdf}


def triangle_rule(order: int) -> tuple[Array, Array]:
    """Gauss's rule on the two halves of the unit square, along whose diagonal sample_triangle has a kink."""
    u, w = gauss(order)
    half = np.stack([u[:, 0], u[:, 0] * u[:, 1]], 1)
    weight = w * u[:, 0]
    return np.concatenate([half, half[:, ::-1]]), np.concatenate([weight, weight])


@pytest.mark.parametrize("omega", SOLID_ANGLES)
def test_mesh_is_unbiased(omega):
    """Triangles whose areas span six orders of magnitude; each with its exact share of the picks."""
    rng = np.random.default_rng(1)
    size = 0.5 * np.sqrt(omega) * 10.0 ** rng.uniform(-3, 0, (40, 1, 1))
    corners = rng.uniform(-0.5, 0.5, (40, 3, 3)) * size + rng.uniform(-0.5, 0.5, (40, 1, 3)) * np.sqrt(omega)
    corners = float32(corners + [0, 0, 0.9])
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0
    corners = np.where(facing[:, None, None], corners, corners[:, ::-1])
    light = mesh_light(corners)
    p = float32(np.c_[rng.uniform(-0.3, 0.3, (30, 2)), rng.uniform(-0.3, 0, 30)])
    n = float32(unit(np.array([0, 0, 1]) + 0.2 * rng.normal(size=(30, 3))))

    edges = np.r_[0, light["cdf"].astype(float)]
    edges[-1] = 2.0**32
    picks = np.append((edges[:-1] + edges[1:]) / 2, 0)[:-1].astype(np.uint32)
    u, weight = triangle_rule(6)
    found = np.zeros(len(p))
    for pick, share in zip(picks, np.diff(edges) / 2.0**32, strict=True):
        found += share * (sample("mesh", light, p, n, u, pick)["irradiance"] @ weight)
    truth = np.zeros(len(p))
    b, area_weight = triangle_rule(8)
    b = b[: len(b) // 2]
    for v0, v1, v2 in corners:
        to = v0 + b[:, :1] * (v1 - v0) + b[:, 1:] * (v2 - v1) - p[:, None]
        normal = np.cross(v1 - v0, v2 - v0)
        patch = np.maximum(dot(to, n[:, None]), 0) * np.maximum(-dot(to, normal), 0) / dot(to, to) ** 2
        truth += patch @ area_weight[: len(b)]
    assert_unbiased(found, truth)


@pytest.mark.parametrize("count", [1, 2, 3, 1000])
def test_picks_follow_the_areas(count):
    area = np.random.default_rng(0).exponential(size=count)
    cdf = np.minimum(np.round(np.cumsum(area) / area.sum() * 2.0**32), 2.0**32 - 1).astype(np.uint32)
    near = (cdf[:, None].astype(np.int64) + [-1, 0, 1]).ravel()
    pick = np.unique(np.r_[0, near, 2**32 - 1, np.random.default_rng(1).integers(0, 2**32, 1000)].clip(0, 2**32 - 1))
    code = f"found[i] = cdf_find(cdf, {count}, pick[i]);"
    found = evaluate("light.h", code, len(pick), {"found": np.int32}, cdf=cdf, pick=pick.astype(np.uint32))["found"]
    assert (found == np.minimum(np.searchsorted(cdf, pick, side="right"), count - 1)).all()


# Spheres --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("omega", SOLID_ANGLES)
def test_sphere_is_unbiased(omega):
    rng = np.random.default_rng(2)
    sine = np.sqrt(1 - (1 - omega / (2 * np.pi)) ** 2)
    p, d = float32(rng.uniform(-0.3, 0.3, (300, 3))), random_units(300, rng)
    n = float32(unit(d + 0.4 * rng.uniform(-1, 1, (300, 3))))
    rows = light_rows("SPHERE", 300)
    rows["position"] = p + 0.5 * d
    rows["radius"] = 0.5 * sine
    x, w = np.polynomial.legendre.leggauss(16)
    u = np.stack(np.meshgrid((x + 1) / 2, (np.arange(16) + 0.5) / 16), -1).reshape(-1, 2)
    found = sample("sphere", {"light": rows}, p, n, u)["irradiance"] @ np.tile(w / 2 / 16, 16)
    center, radius = rows["position"].astype(float), rows["radius"].astype(float)
    truth = np.pi * radius**2 * dot(center - p, n) / dot(center - p, center - p) ** 1.5
    assert_unbiased(found, truth)


def test_sphere_samples_are_uniform_in_the_cone_and_on_the_sphere():
    """χ² of cosine and azimuth over 2^17 samples; the shadow ray's end is on the near side, outside by the offset."""
    rows = light_rows("SPHERE")
    rows["position"], rows["radius"], rows["offset"] = (0.1, 0.2, 0.9), 0.3, 1e-6
    p, n = np.array([(0.05, -0.1, 0.1)]), np.array([(0.0, 0.0, 1.0)])
    q = sample("sphere", {"light": rows}, float32(p), n, random_u(1 << 17))["q"][0].astype(float)
    center = rows["position"][0].astype(float)
    assert np.abs(np.linalg.norm(q - center, axis=1) - 0.3 - 1e-6).max() < 2e-7
    axis, wi = unit(center - float32(p[0])), unit(q - float32(p[0]))
    assert (dot(q - center, wi) < 1e-3).all()
    cos_max = np.sqrt(1 - 0.09 / dot(center - p[0], center - p[0]))
    height = (1 - dot(wi, axis)) / (1 - cos_max)
    side = unit(np.cross(axis, [1.0, 0, 0]))
    azimuth = np.arctan2(dot(wi, np.cross(axis, side)), dot(wi, side)) / (2 * np.pi) + 0.5
    assert_uniform(np.stack([np.clip(height, 0, 1 - 1e-9), azimuth], 1), 1)


def test_inside_a_sphere_it_is_dark():
    rows = light_rows("SPHERE")
    rows["radius"] = 0.5
    rng = np.random.default_rng(0)
    p = 0.49 * random_units(100, rng) * rng.random((100, 1))
    assert (sample("sphere", {"light": rows}, p, random_units(100, rng), random_u(32))["irradiance"] == 0).all()


# Warps ----------------------------------------------------------------------------------------------------------------


def assert_uniform(points: Array, tests: int) -> None:
    """Fail if χ² of 16 × 16 cells of the unit square has a p-value below 1e-3 / tests (Wilson and Hilferty 1931)."""
    counts, *_ = np.histogram2d(points[:, 0], points[:, 1], 16, [[0, 1], [0, 1]])
    assert counts.sum() == len(points)
    expected = len(points) / 256
    ratio = ((counts - expected) ** 2 / expected).sum() / 255
    score = (ratio ** (1 / 3) - 1 + 2 / (9 * 255)) / np.sqrt(2 / (9 * 255))
    assert score < threshold(tests)


WEIGHTS = np.array([(1, 1, 1, 1), (1, 2, 3, 4), (0, 0, 1, 1), (0, 1, 0, 1), (0, 0, 0, 1), (1, 0, 0, 0), (1, 0, 0, 1.0)])


def bilinear(u: Array, weights: Array) -> tuple[Array, Array]:
    """Points (k, 2) of density proportional to the bilinear function, and its value there."""
    code = "float value; vstore2(sample_bilinear(vload2(i, u), vload4(0, w), &value), i, st); density[i] = value;"
    outputs = {"st": (np.float32, 2), "density": np.float32}
    inputs = {"u": np.minimum(u, 1 - 2.0**-24).astype(np.float32), "w": weights.astype(np.float32)}
    out = evaluate("light.h", code, len(u), outputs, **inputs)
    return out["st"].astype(float), out["density"].astype(float)


def bilinear_cdfs(st: Array, w: Array) -> Array:
    """Where the marginal and the conditional distribution function map points: uniform, if they have the density."""
    s, t = st.T
    low, high = w[0] + w[1], w[2] + w[3]
    a, b = w[0] + (w[2] - w[0]) * t, w[1] + (w[3] - w[1]) * t
    return np.stack([linear_cdf(s, a, b), linear_cdf(t, low, high)], 1)


def linear_cdf(x: Array, a: Any, b: Any) -> Array:
    return (2 * a * x + (b - a) * x * x) / (a + b)


@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e12])
def test_bilinear_warp(scale):
    u = random_u(1 << 16)
    for weights in WEIGHTS * scale:
        st, density = bilinear(u, weights)
        assert ((st >= 0) & (st <= 1)).all()
        assert_uniform(np.clip(bilinear_cdfs(st, weights), 0, 1), len(WEIGHTS))
        s, t = st.T
        truth = (weights[0] * (1 - s) + weights[1] * s) * (1 - t) + (weights[2] * (1 - s) + weights[3] * s) * t
        assert np.abs(density - truth).max() < 4e-7 * weights.max()


def test_bilinear_warp_at_the_corners():
    """At 0 and just below 1 too it stays in the square, and near the corner where there is any density."""
    u = np.array([(0, 0), (0, 1), (1, 0), (1, 1)], float)
    for weights in WEIGHTS:
        st, density = bilinear(u, weights)
        assert ((st >= 0) & (st <= 1)).all()
        assert (density >= 0).all()
        assert (np.abs(st - u).max(1) < 1e-3)[(weights > 0).all() | (weights[[0, 2, 1, 3]] > 0)].all()


def test_triangle_warp():
    """Uniform barycentrics: (√(b1 + b2))², b1 / (b1 + b2) are uniform and independent."""
    code = "vstore2(sample_triangle(vload2(i, u)), i, b);"
    u = np.concatenate([random_u(1 << 17), [(0, 0), (0, 1), (1, 0), (1, 1)]])
    inputs = {"u": np.minimum(u, 1 - 2.0**-24).astype(np.float32)}
    b = evaluate("sampling.h", code, len(u), {"b": (np.float32, 2)}, **inputs)["b"].astype(float)
    assert (b >= 0).all()
    assert (b.sum(1) <= 1).all()
    b = b[:-4]
    assert_uniform(np.stack([b.sum(1) ** 2, b[:, 0] / b.sum(1)], 1), 1)
