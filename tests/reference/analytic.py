"""Closed forms of direct light and of refraction, in float64, vectorised over points.

Points and normals are (n, 3). Irradiance is per unit of emitted radiance (area lights) or in W/m² (point lights); the
radiance that a diffuse surface of reflectance ρ sends back is ρ·E/π. Every direction given must be of unit length.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.scene import SpotLight

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

FORM_FACTOR_PARALLEL = 0.1998249  # unit squares that face each other at distance 1
FORM_FACTOR_PERPENDICULAR = 0.2000438  # unit squares with a common edge, at a right angle
CLEARANCE = 1e-9  # an occluder counts where it is this far above the receiver and in front of the light


def dot(a: Array, b: Array) -> Array:
    """Scalar products along the last axis."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def unit(v: ArrayLike) -> Array:
    v = np.asarray(v, float)
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


# Lights ---------------------------------------------------------------------------------------------------------------


def point_irradiance(points: Array, normals: Array, position: ArrayLike, flux: ArrayLike) -> Array:
    """(n, 3) irradiance max(0, n·ω) Φ / 4πr² of a point light."""
    to_light = np.asarray(position, float) - points
    r2 = dot(to_light, to_light)
    cosine = np.maximum(0.0, dot(normals, to_light)) / np.sqrt(r2)
    return np.asarray((cosine / (4 * np.pi * r2))[..., None] * np.asarray(flux, float))


def spot_irradiance(points: Array, normals: Array, light: SpotLight) -> Array:
    """(n, 3) irradiance of a spot light: a point light's, faded by ((cos θ − cos outer) / (cos inner − cos outer))²."""
    inner, outer = np.cos(np.radians([light.inner, light.outer]))
    away = unit(points - np.asarray(light.position, float))
    share = np.clip((dot(away, np.array(light.direction)) - outer) / (inner - outer), 0, 1) ** 2
    flux = 4 * np.pi * np.array(light.intensity)
    return share[:, None] * point_irradiance(points, normals, light.position, flux)


def sphere_irradiance(points: Array, normals: Array, center: ArrayLike, radius: float) -> Array:
    """(n,) irradiance π sin²α cosθ of a sphere of radiance 1 that lies wholly above each point's horizon."""
    to_center = np.asarray(center, float) - points
    d2 = dot(to_center, to_center)
    height = dot(normals, to_center)
    assert (height >= radius).all(), "the sphere must lie above the horizon"
    return np.pi * radius**2 * height / d2**1.5


def clip(polygons: Array, distance: Array) -> Array:
    """The part of convex polygons (n, k, 3) where distance (n, k) is >= 0 (Sutherland and Hodgman 1974), (n, k', 3).

    A polygon with fewer corners than k' repeats its last one; an empty one is all zeros.
    """
    following, distance_next = np.roll(polygons, -1, 1), np.roll(distance, -1, 1)
    inside, crosses = distance >= 0, (distance >= 0) != (distance_next >= 0)
    fraction = np.divide(distance, distance - distance_next, out=np.zeros_like(distance), where=crosses)
    corners = np.stack([polygons, polygons + fraction[..., None] * (following - polygons)], 2)
    kept = np.stack([inside, crosses], 2).reshape(len(polygons), 2 * polygons.shape[1])
    count = kept.sum(1)[:, None]
    slot = np.minimum(np.arange(max(count.max(initial=0), 1)), np.maximum(count - 1, 0))
    chosen = np.take_along_axis(np.argsort(~kept, axis=1, kind="stable"), slot, 1)
    clipped = np.take_along_axis(corners.reshape(*kept.shape, 3), chosen[..., None], 1)
    return np.where(count[..., None] > 0, clipped, 0.0)


def cone_irradiance(cones: Array, normals: Array) -> Array:
    """(n,) integral of n·ω over the cones that polygons (n, k, 3) span from the origin, clockwise seen from there.

    Lambert's formula ½ Σ θ_i Γ̂_i·n; polygons must lie above the horizon. Clockwise is how an emitter's front looks
    through its own plane, so that the front counts as positive.
    """
    following = np.roll(cones, -1, 1)
    gamma = np.cross(following, cones)
    length = np.linalg.norm(gamma, axis=-1)
    angle = np.arctan2(length, dot(cones, following))
    cosine = np.divide(dot(gamma, normals[:, None]), length, out=np.zeros_like(angle), where=length > 0)
    return np.asarray(0.5 * (angle * cosine).sum(1))


def polygon_irradiance(points: Array, normals: Array, light: ArrayLike) -> Array:
    """(n,) irradiance of a convex polygon (k, 3) of radiance 1, clipped to the horizon; counter-clockwise in front."""
    cones = np.asarray(light, float) - points[:, None]
    return np.maximum(0.0, cone_irradiance(clip(cones, dot(cones, normals[:, None])), normals))


def visible_irradiance(
    points: Array, normals: Array, light: ArrayLike, occluders: Array, shading_normals: Array | None = None
) -> Array:
    """(n,) irradiance of a polygon light behind triangles (m, 3, 3), exact: what they hide is cut out of the polygon.

    The horizon is that of `normals`; the cosine is with `shading_normals` where they are given.
    """
    shading = normals if shading_normals is None else shading_normals
    polygon = np.asarray(light, float)
    front = unit(np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0]))
    owner = np.flatnonzero(dot(points - polygon[0], front) > 0)
    pieces = polygon - points[owner, None]
    for side in (normals, shading):
        pieces = clip(pieces, dot(pieces, side[owner, None]))
    for triangle in np.asarray(occluders, float):
        if (dot(triangle - polygon[0], front) > CLEARANCE).any():
            chosen = np.flatnonzero(_overlaps(points, normals, polygon, triangle)[owner])
            shadows = _shadow(points[owner[chosen]], normals[owner[chosen]], polygon[0], front, triangle)
            pieces, owner = _cut(pieces, owner, chosen, _edge_planes(shadows))
    return np.bincount(owner, cone_irradiance(pieces, shading[owner]), len(points)).astype(float)


def _overlaps(points: Array, normals: Array, polygon: Array, triangle: Array) -> NDArray[np.bool_]:
    """(n,) whether the cones of the two polygons may overlap: no edge plane of either separates them."""
    overlap = (dot(triangle - points[:, None], normals[:, None]) > CLEARANCE).any(1)
    a, b = polygon - points[:, None], triangle - points[:, None]
    for first, second in ((a, b), (b, a)):
        overlap &= (np.einsum("nei,nvi->nev", _edge_planes(first), second) > 0).any(2).all(1)
    return np.asarray(overlap)


def _edge_planes(cones: Array) -> Array:
    """(n, k, 3) normals of the planes through the origin and each edge, towards the inside; zero for an empty edge."""
    following = np.roll(cones, -1, 1)
    planes = np.cross(cones, following)
    scale = np.linalg.norm(cones, axis=-1) * np.linalg.norm(following, axis=-1)
    planes[np.linalg.norm(planes, axis=-1) <= 1e-11 * scale] = 0.0
    return np.asarray(planes * np.sign(np.einsum("nei,nvi->n", planes, cones))[:, None, None])


def _shadow(points: Array, normals: Array, on_light: Array, front: Array, triangle: Array) -> Array:
    """(n, k, 3) part of a triangle between each point's horizon and the light's plane, relative to the point."""
    cones = triangle - points[:, None]
    cones = clip(cones, dot(cones, normals[:, None]) - CLEARANCE)
    return clip(cones, dot(cones + points[:, None] - on_light, front) - CLEARANCE)


def _cut(pieces: Array, owner: Indices, chosen: Indices, planes: Array) -> tuple[Array, Indices]:
    """Replace each chosen piece by what is left of it outside the convex cone with these edge planes."""
    chosen, planes = chosen[(planes != 0).any((1, 2))], planes[(planes != 0).any((1, 2))]
    rest, kept, owners = pieces[chosen], [np.delete(pieces, chosen, 0)], [np.delete(owner, chosen)]
    for plane in np.moveaxis(planes, 1, 0):
        side = dot(rest, plane[:, None])
        outside = clip(rest, np.where((plane != 0).any(1)[:, None], -side, -1.0))
        kept.append(outside[outside.any((1, 2))])
        owners.append(owner[chosen][outside.any((1, 2))])
        rest = clip(rest, side)
    corners = max(piece.shape[1] for piece in kept)
    padded = [np.pad(piece, ((0, 0), (0, corners - piece.shape[1]), (0, 0)), mode="edge") for piece in kept]
    return np.concatenate(padded), np.concatenate(owners)


def unoccluded(occluder: Array, apexes: Array, targets: Array) -> NDArray[np.bool_]:
    """(n,) proof that no segment from the hull of apexes (n, k, 3) to that of targets (n, m, 3) meets the occluder's.

    It looks for a separating plane through an apex and two of the occluder's corners (c, 3); False: none was found.
    """
    free = np.zeros(len(targets), bool)
    ends = np.concatenate([apexes, targets], 1)
    for apex, a, b in itertools.product(range(apexes.shape[1]), range(len(occluder)), range(len(occluder))):
        left = np.flatnonzero(~free)
        spokes = occluder - apexes[left, apex, None]
        plane = np.cross(spokes[:, a], spokes[:, b])[:, None]
        behind = dot(plane, spokes) <= 1e-12
        before = dot(plane, ends[left] - apexes[left, apex, None]) >= -1e-12
        free[left] = behind.all(1) & before.all(1) & (plane != 0).any((1, 2))
    return free


# Refraction -----------------------------------------------------------------------------------------------------------


def refract(directions: Array, normals: Array, eta: ArrayLike) -> Array:
    """(n, 3) directions after a smooth surface where sinθ_t = eta · sinθ_i; total internal reflection mirrors.

    `normals` may point to either side. Snell's law in vector form (Glassner 1989).
    """
    normals = normals * -np.sign(dot(normals, directions))[..., None]
    cosine = -dot(normals, directions)
    eta = np.broadcast_to(np.asarray(eta, float), cosine.shape)
    cos2_t = 1 - eta**2 * (1 - cosine**2)
    along = np.where(cos2_t > 0, eta * cosine - np.sqrt(np.maximum(cos2_t, 0)), 2 * cosine)
    return np.where(cos2_t > 0, eta, 1.0)[..., None] * directions + along[..., None] * normals


def fresnel(cosine: ArrayLike, eta: ArrayLike) -> Array:
    """Unpolarised reflectance of a dielectric with sinθ_t = eta · sinθ_i; 1 beyond the critical angle."""
    cos_i = np.abs(np.asarray(cosine, float))
    ratio = np.asarray(eta, float)
    cos2_t = 1 - ratio**2 * (1 - cos_i**2)
    cos_t = np.sqrt(np.maximum(cos2_t, 0))
    parallel = (cos_i - ratio * cos_t) / (cos_i + ratio * cos_t)
    perpendicular = (ratio * cos_i - cos_t) / (ratio * cos_i + cos_t)
    return np.where(cos2_t > 0, (parallel**2 + perpendicular**2) / 2, 1.0)


def slab_shift(theta: ArrayLike, thickness: float, ior: float) -> Array:
    """Lateral shift t sinθ (1 − cosθ / √(n² − sin²θ)) of a ray that crosses a plane-parallel plate at angle θ (rad)."""
    sine, cosine = np.sin(np.asarray(theta, float)), np.cos(np.asarray(theta, float))
    return np.asarray(thickness * sine * (1 - cosine / np.sqrt(ior**2 - sine**2)))


def slab_transmittance(cosine: ArrayLike, ior: float) -> Array:
    """(1 − R) / (1 + R): all orders of internal reflection through a plate of glass, without absorption."""
    reflectance = fresnel(cosine, 1 / ior)
    return (1 - reflectance) / (1 + reflectance)


def prism_deviation(theta: Array, apex: float, ior: float) -> Array:
    """Angle (rad) by which a prism of the given apex angle turns a ray that enters it at angle θ: θ_1 + θ_4 − apex."""
    inside = apex - np.arcsin(np.sin(theta) / ior)
    return np.asarray(theta + np.arcsin(ior * np.sin(inside)) - apex)


def ball_lens_deviation(offset: ArrayLike, radius: float, ior: float) -> Array:
    """Angle (rad) 2(θ_i − θ_t) by which a ball turns a ray that passes its centre at the given distance."""
    sine = np.asarray(offset, float) / radius
    return np.asarray(2 * (np.arcsin(sine) - np.arcsin(sine / ior)))
