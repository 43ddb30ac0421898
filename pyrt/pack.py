"""Scene → the arrays that the kernels read: normalised, float32, laid out as `kernels/types.h` says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import groupby
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.camera import film_plane
from pyrt.features import has_corners, used_textures
from pyrt.geometry import (
    LocalTriangles,
    Normalisation,
    Triangles,
    gather_triangles,
    local_triangles,
    normalisation,
    parts,
    rounding_offset,
    sphere_offset,
    triangle_normals,
)
from pyrt.layout import aligned_empty, constants, dtypes
from pyrt.pack_lights import pack_lights
from pyrt.sah import Splitter, split
from pyrt.scene import (
    Camera,
    CheckerboardTexture,
    ConstantTexture,
    Dielectric,
    Diffuse,
    ImageTexture,
    Mesh,
    Rectangle,
    Refraction,
    Scene,
    Shape,
    Sphere,
)
from pyrt.tree import build_tree

# Its square has to fit float32. Beyond, a ray leaves along the normal or is reflected, as far as float32 can tell.
_ETA_RANGE = (2.0**-32, 2.0**32)


@dataclass(frozen=True)
class PackedScene:
    """Device arrays by the name of the kernel argument, in their order, and what the host still needs to know."""

    arrays: dict[str, NDArray[Any]]
    params: NDArray[Any]  # SceneParams, without the camera
    space: Normalisation
    bound: NDArray[np.float64]  # (3,), |x| of the normalised scene
    report: dict[str, Any]  # counts for `info` and `stats`


def pack_scene(scene: Scene, splitter: Splitter = split) -> PackedScene:
    """Everything of the scene but its camera (see `pack_camera`). `splitter` builds the tree."""
    arrays, triangles, space, local = _pack_surfaces(scene)
    start = perf_counter()
    tree = build_tree(local.corners, arrays["spheres"], splitter)
    build_seconds = perf_counter() - start
    arrays = {
        "nodes": tree.nodes,
        "triangle_blocks": tree.triangle_blocks,
        "sphere_blocks": tree.sphere_blocks,
        "triangles": arrays.pop("triangles"),
        "corners": _pack_corners(scene, triangles),
        **arrays,
    }
    bound = _bound(local, arrays["spheres"])
    params = np.zeros((), dtypes()["SceneParams"])
    params["root"] = tree.root
    params["triangle_count"] = len(local.corners)
    params["light_count"] = len(arrays["lights"])
    params["bound"] = round_up(bound)
    report = {
        "triangles": len(local.corners),
        "spheres": len(arrays["spheres"]),
        "lights": len(arrays["lights"]),
        "texels": len(arrays["texels"]) // 3,
        "nodes": len(tree.nodes),
        "blocks": len(tree.triangle_blocks) + len(tree.sphere_blocks),
        "depth": tree.depth,
        "dropped_triangles": triangles.dropped,
        "build_seconds": build_seconds,
        "bytes": sum(array.nbytes for array in arrays.values()),
    }
    return PackedScene(arrays, params, space, bound, report)


def _pack_surfaces(scene: Scene) -> tuple[dict[str, NDArray[Any]], Triangles, Normalisation, LocalTriangles]:
    """All arrays but the corners' and the tree's, which needs the local triangles.

    The triangles return without their place in the world, in float64: the tree's builder needs the room.
    """
    triangles = gather_triangles(scene)
    spheres = [s for s in scene.shapes if isinstance(s, Sphere)]
    space = normalisation(triangles.corners.reshape(-1, 3), spheres)
    local = local_triangles(triangles.corners, space)
    lights, light_of_shape, cdf = pack_lights(scene, triangles, local.largest_edge, space)
    textures, texels = _pack_textures(scene)
    arrays = {
        "triangles": _pack_triangles(scene, triangles, local.largest_edge, space, light_of_shape),
        "spheres": _pack_spheres(scene, spheres, light_of_shape, space),
        "materials": _pack_materials(scene),
        "textures": textures,
        "texels": texels,
        "lights": lights,
        "cdf": cdf,
    }
    return arrays, replace(triangles, corners=triangles.corners[:0].copy()), space, local


def pack_camera(packed: PackedScene, camera: Camera, width: int, height: int) -> NDArray[Any]:
    """The Camera struct for a film of the given size. A camera outside the scene's box starts its rays on a plane
    just before the box, so that float32 need not hold the distance."""
    plane = film_plane(camera, width, height)
    position = packed.space.apply(plane.position)
    nearest = float(-position @ plane.forward - packed.bound @ np.abs(plane.forward))
    advance = max(0.0, nearest - 2.0**-8)
    out = np.zeros((), dtypes()["Camera"])
    with np.errstate(over="ignore"):  # from farther than float32 reaches, nothing is seen: such a ray misses
        out["origin"] = position + advance * plane.corner
        out["origin_dx"], out["origin_dy"] = advance * plane.dx, advance * plane.dy
    out["direction"], out["direction_dx"], out["direction_dy"] = plane.corner, plane.dx, plane.dy
    return out


def round_up(x: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.nextafter(x.astype(np.float32), np.float32(np.inf))


def _bound(local: LocalTriangles, spheres: NDArray[Any]) -> NDArray[np.float64]:
    if not len(spheres):
        return local.bound
    reach = np.abs(spheres["center"].astype(np.float64)) + spheres["radius"][:, None].astype(np.float64)
    return np.asarray(np.maximum(local.bound, reach.max(axis=0)), np.float64)


def _material(shape: Shape) -> int:
    return -1 if shape.material is None else shape.material


def _pack_triangles(
    scene: Scene,
    triangles: Triangles,
    largest_edge: float,
    space: Normalisation,
    light_of_shape: NDArray[np.int32],
) -> NDArray[Any]:
    material_of_shape = np.array([_material(s) for s in scene.shapes], np.int32)
    out = aligned_empty(len(triangles.shape), dtypes()["Triangle"])
    for part in parts(len(out)):
        rows, world = out[part], triangles.corners[part]
        corners = space.apply(world)
        v0, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        n = triangle_normals(world)  # far from the centre, normalised edges may have lost theirs
        rows["v0"], rows["e1"], rows["e2"], rows["n"] = v0, e1, e2, n
        rows["offset"] = rounding_offset(v0, e1, e2, n, largest_edge)
        rows["material"] = material_of_shape[triangles.shape[part]]
        rows["light"] = light_of_shape[triangles.shape[part]]
    out["corners"] = _corner_index(scene, triangles)
    return out


def _with_corners(scene: Scene) -> NDArray[np.bool_]:
    """Whether each shape's triangles have attributes at their corners that matter."""
    textures = any(not isinstance(scene.textures[i], ConstantTexture) for i in used_textures(scene))
    return np.array([has_corners(shape, textures) for shape in scene.shapes], np.bool_)


def _corner_index(scene: Scene, triangles: Triangles) -> NDArray[np.int32]:
    """Of each triangle the index of its attributes, or −1."""
    having = _with_corners(scene)[triangles.shape]
    return np.where(having, np.cumsum(having, dtype=np.int32) - 1, np.int32(-1))


def _pack_corners(scene: Scene, triangles: Triangles) -> NDArray[Any]:
    """Attributes of the triangles that have some which matter."""
    having = _with_corners(scene)
    mine = having[triangles.shape]
    source = triangles.source[mine]
    starts = np.searchsorted(triangles.shape[mine], np.arange(len(having) + 1))
    out = aligned_empty(len(source), dtypes()["Corners"])
    for rectangles, run in groupby(np.flatnonzero(having), lambda i: isinstance(scene.shapes[i], Rectangle)):
        together = list(run)
        for i in [together] if rectangles else ([i] for i in together):  # those of rectangles are all alike
            first, end = starts[i[0]], starts[i[-1] + 1]
            for part in parts(end - first):
                rows = slice(first + part.start, first + part.stop)
                out[rows] = shape_corners(scene.shapes[i[0]], source[rows])
    return out


def shape_corners(shape: Shape, source: NDArray[np.int32]) -> NDArray[Any]:
    """Corners (k,) of triangles of a mesh or rectangle, by their index in it; normals are 0 where it is flat."""
    out = np.zeros(len(source), dtypes()["Corners"])
    if isinstance(shape, Rectangle):
        out["uv"] = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], np.float32)[source]
        return out
    assert isinstance(shape, Mesh)
    out["uv"] = shape.uvs[source] if shape.uvs is not None else np.array([(0, 0), (1, 0), (1, 1)], np.float32)
    if shape.normals is not None:
        out["n"] = shape.normals[source]
    return out


def _pack_spheres(
    scene: Scene, spheres: list[Sphere], light_of_shape: NDArray[np.int32], space: Normalisation
) -> NDArray[Any]:
    indices = [i for i, s in enumerate(scene.shapes) if isinstance(s, Sphere)]
    out = np.zeros(len(spheres), dtypes()["Sphere"])
    if not spheres:
        return out
    center = space.apply(np.array([s.center for s in spheres], np.float64))
    radius = np.array([s.radius for s in spheres], np.float64) * space.scale
    out["center"], out["radius"] = center, radius
    out["offset"] = sphere_offset(center, radius)
    out["material"] = [_material(s) for s in spheres]
    out["light"] = light_of_shape[indices]
    return out


def _pack_materials(scene: Scene) -> NDArray[Any]:
    kinds = constants()
    out = np.zeros(len(scene.materials), dtypes()["Material"])
    for row, material in zip(out, scene.materials, strict=True):
        if isinstance(material, Diffuse):
            row["kind"], row["texture"], row["twosided"] = (
                kinds["MATERIAL_DIFFUSE"],
                material.texture,
                material.twosided,
            )
        elif isinstance(material, Refraction):
            row["kind"], row["eta"] = kinds["MATERIAL_REFRACTION"], np.clip(material.eta, *_ETA_RANGE)
        elif isinstance(material, Dielectric):
            eta = material.ext_ior / material.int_ior
            row["kind"], row["eta"] = kinds["MATERIAL_DIELECTRIC"], np.clip(eta, *_ETA_RANGE)
    return out


def _pack_textures(scene: Scene) -> tuple[NDArray[Any], NDArray[np.float32]]:
    """Textures, and the texels of the images that some used material reads."""
    kinds = constants()
    used = set(used_textures(scene))
    out = np.zeros(len(scene.textures), dtypes()["Texture"])
    texels = [np.empty(0, np.float32)]
    first = 0
    for i, (row, texture) in enumerate(zip(out, scene.textures, strict=True)):
        if isinstance(texture, ConstantTexture):
            row["kind"], row["color0"] = kinds["TEXTURE_CONSTANT"], texture.color
            continue
        row["scale_s"], row["scale_t"] = texture.scale
        row["delta"] = texture.delta
        if isinstance(texture, CheckerboardTexture):
            row["kind"], row["color0"], row["color1"] = kinds["TEXTURE_CHECKERBOARD"], texture.color0, texture.color1
        elif isinstance(texture, ImageTexture) and i in used:
            row["kind"], row["texels"] = kinds["TEXTURE_IMAGE"], first
            row["height"], row["width"] = texture.pixels.shape[:2]
            texels.append(texture.pixels.reshape(-1))
            first += texture.pixels.shape[0] * texture.pixels.shape[1]
    return out, texels[-1] if len(texels) == 2 else np.concatenate(texels)  # no copy of a single image
