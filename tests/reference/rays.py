"""What ray queries against float32 triangles must find, and how far off they may be: brute force in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .analytic import Array

ULP = 2.0**-24  # relative rounding error of float32
ROUNDINGS = 16  # in a ray, the corners of a triangle and their test; each moves something by at most half an ulp
CHUNK = 1 << 20  # pairs of ray and triangle at a time


def slack(vertices: Array, origins: Array) -> Array:
    """(k,): how far a ray may seem to lie beside its place, in units of the (n, 3) vertices.

    Coordinates count from the middle of the mesh, and a distant origin from the mesh's box, because there the float32
    arithmetic begins.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = (high - low).max() / 2
    away = np.abs(origins - (low + high) / 2).max(axis=1)
    return ROUNDINGS * ULP * (np.minimum(away, 8 * half) + 2 * half)


def hit_errors(vertices: Array, triangles: NDArray[np.integer], o: Array, d: Array, hits: object) -> Array:
    """(k,) distances between o + t·d and the point of the triangle at (u, v), in units of `slack`; 0 for a miss.

    If none exceeds 1, then every hit is on a triangle that the ray meets, give or take the rounding.
    """
    found = hits.triangle >= 0
    corners = vertices[triangles[hits.triangle[found]]]
    u, v = hits.u[found, None], hits.v[found, None]
    on_triangle = corners[:, 0] + u * (corners[:, 1] - corners[:, 0]) + v * (corners[:, 2] - corners[:, 0])
    on_ray = o[found] + hits.t[found, None] * d[found]
    errors = np.zeros(len(o))
    errors[found] = np.linalg.norm(on_triangle - on_ray, axis=1) / slack(vertices, o[found])
    outside = (u < 0) | (v < 0) | (u + v > 1 + 4 * ULP)
    assert not outside.any()
    return errors


def closest_hit(corners: Array, origins: Array, directions: Array, hair: float = 1e-12) -> Array:
    """(k,): the t of the first of the (m, 3, 3) triangles, inf for a miss (Möller and Trumbore 1997).

    `hair`: how far beyond an edge, in barycentrics, still counts.
    """
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    length = np.linalg.norm(directions, axis=1)
    best = np.full(len(origins), np.inf)
    for part in np.array_split(np.arange(len(origins)), len(origins) * len(corners) // 2_000_000 + 1):
        d = directions[part] / length[part, None]
        offset = origins[part, None] - corners[:, 0]
        moment = np.cross(offset, d[:, None])
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = -1 / (d @ np.cross(e1, e2).T)
            u, v = (moment * e2).sum(-1) * scale, -(moment * e1).sum(-1) * scale
            t = (offset * np.cross(e1, e2)).sum(-1) * scale
            hit = (np.minimum(np.minimum(u, v), 1 - u - v) >= -hair) & (t > 0)
        best[part] = np.where(hit, t, np.inf).min(axis=1) / length[part]
    return best


def farthest_hit(corners: Array, o: Array, d: Array) -> Array:
    """(k,): the t by which rays must have hit one of the (m, 3, 3) triangles; inf if they may miss them all.

    A ray must hit a triangle if it passes inside of every edge by more than the slack; t may be off by the slack times
    what the triangle's slope makes of it.
    """
    vertices = corners.reshape(-1, 3)
    step = max(1, CHUNK // len(corners))
    chunks = [slice(i, i + step) for i in range(0, len(o), step)]
    return np.concatenate([_farthest(corners, o[c], d[c], slack(vertices, o[c])) for c in chunks])


def _farthest(corners: Array, o: Array, d: Array, allowed: Array) -> Array:
    length = np.linalg.norm(d, axis=1)
    axes = np.stack(_frame(d / length[:, None]), axis=1)  # (k, 3 axes, 3)
    local = np.einsum("kmvx,kax->kmva", corners[None] - o[:, None, None], axes)  # the ray is the last axis
    flat, depth = local[..., :2], local[..., 2]
    edge = np.roll(flat, -1, axis=2) - flat
    size = np.linalg.norm(edge, axis=3)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = edge[..., 0] * flat[..., 1] - edge[..., 1] * flat[..., 0]  # of the opposite corner
        area = weight.sum(axis=2)
        margin = (np.sign(area)[..., None] * weight / size).min(axis=2)
        at = (weight * np.roll(depth, 1, axis=2)).sum(axis=2) / area
        e1, e2 = local[:, :, 1] - local[:, :, 0], local[:, :, 2] - local[:, :, 0]
        normal = np.abs(np.cross(e1, e2))
        slope = np.hypot(normal[..., 0], normal[..., 1]) / normal[..., 2]
        blur = allowed[:, None] * (1 + slope)
        sure = (margin > allowed[:, None]) & (at > blur)
        return np.where(sure, at + blur, np.inf).min(axis=1) / length


def _frame(axis: Array) -> tuple[Array, Array, Array]:
    """Two unit vectors perpendicular to each of the (k, 3) unit vectors, and these."""
    helper = np.where(np.abs(axis[:, :1]) < 0.5, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(axis, first), axis
