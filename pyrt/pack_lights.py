"""Lights of a scene as the kernels sample them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.geometry import (
    Normalisation,
    Triangles,
    rectangle_corners,
    rounding_offset,
    scaled_edges,
    sphere_offset,
    unit,
)
from pyrt.layout import constants, dtypes
from pyrt.scene import Light, Rectangle, Scene, Sphere, SpotLight

# Extents to the scene. A point light beyond is moved in to this distance and dimmed, so that the light in the scene is
# the same to float32's precision, and no square of a distance overflows.
_FARTHEST = 2.0**24
_STEEPEST = 1e30  # fall of a cone, finite in float32


def pack_lights(
    scene: Scene, triangles: Triangles, largest_edge: float, space: Normalisation
) -> tuple[NDArray[Any], NDArray[np.int32], NDArray[np.uint32]]:
    """Lights, the light index of each shape (or −1), and the cumulative areas of mesh lights.

    `largest_edge`: of the normalised triangles.
    """
    light_of_shape = np.full(len(scene.shapes), -1, np.int32)
    rows: list[NDArray[Any]] = [_point_light(light, space) for light in scene.lights]
    cdfs = [np.empty(0, np.uint32)]
    sphere_id = len(triangles.shape)
    for i, shape in enumerate(scene.shapes):
        mine = triangles.of_shape(i) if shape.radiance is not None else np.empty(0, np.intp)
        if shape.radiance is not None and (isinstance(shape, Sphere) or len(mine)):
            light_of_shape[i] = len(rows)
            if isinstance(shape, Sphere):
                row = _sphere_light(shape, sphere_id, space)
            elif isinstance(shape, Rectangle):
                row = _rectangle_light(shape, mine, largest_edge, space)
            else:
                row, cdf = _mesh_light(mine, triangles.corners[mine], sum(len(c) for c in cdfs))
                cdfs.append(cdf)
            row["emission"] = shape.radiance
            rows.append(row)
        sphere_id += isinstance(shape, Sphere)
    out = np.array(rows, dtypes()["Light"]) if rows else np.zeros(0, dtypes()["Light"])
    return out, light_of_shape, np.concatenate(cdfs)


def _light_row(kind: str, first: int, count: int) -> NDArray[Any]:
    row = np.zeros((), dtypes()["Light"])
    row["kind"], row["first"], row["count"] = constants()[kind], first, count
    return row


def _point_light(light: Light, space: Normalisation) -> NDArray[Any]:
    row = _light_row("LIGHT_POINT", 0, 0)
    if isinstance(light, SpotLight):
        inner, outer = (4 * np.sin(np.radians(angle) / 2) ** 2 for angle in (light.inner, light.outer))
        row["n"], row["cone_inner"] = light.direction, inner
        row["cone_slope"] = min(1 / max(outer - inner, 1e-300), _STEEPEST)
        power = np.asarray(light.intensity)
    else:
        power = np.asarray(light.flux) / (4 * np.pi)
    position = space.apply(np.asarray(light.position))
    nearer = min(1.0, _FARTHEST / max(float(np.abs(position).max()), 1.0))
    row["position"] = position * nearer
    with np.errstate(over="ignore"):
        intensity = power * (space.scale * nearer) * (space.scale * nearer)
    row["emission"] = np.minimum(intensity, np.finfo(np.float32).max)
    return row


def _rectangle_light(
    shape: Rectangle, mine: NDArray[np.intp], largest_edge: float, space: Normalisation
) -> NDArray[Any]:
    row = _light_row("LIGHT_RECTANGLE", int(mine[0]), len(mine))
    low = space.apply(rectangle_corners(shape))[0]
    e1, e2 = np.asarray(shape.edge1) * space.scale, np.asarray(shape.edge2) * space.scale
    normal = np.cross(unit(e1), unit(e2))  # of unit vectors, for that of tiny ones is 0
    row["position"], row["edge1"], row["edge2"], row["n"] = low, e1, e2, unit(normal)
    row["area"] = np.linalg.norm(e1) * np.linalg.norm(e2) * np.linalg.norm(normal)
    row["offset"] = rounding_offset(low, e1, e2, unit(normal), largest_edge)
    return row


def _mesh_light(
    mine: NDArray[np.intp], corners: NDArray[np.float64], first: int
) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    row = _light_row("LIGHT_MESH", int(mine[0]), len(mine))
    row["cdf"] = first
    e1, e2, size = scaled_edges(corners)
    areas = np.linalg.norm(np.cross(e1, e2), axis=1) * (size / size.max()) ** 2
    cumulative = np.round(np.cumsum(areas) / areas.sum() * 2.0**32)
    return row, np.minimum(cumulative, 2.0**32 - 1).astype(np.uint32)


def _sphere_light(shape: Sphere, sphere_id: int, space: Normalisation) -> NDArray[Any]:
    row = _light_row("LIGHT_SPHERE", sphere_id, 1)
    center = space.apply(np.asarray(shape.center))
    row["position"], row["radius"] = center, shape.radius * space.scale
    row["offset"] = sphere_offset(center, row["radius"])
    return row
