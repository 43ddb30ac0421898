"""Mitsuba 3 as a peer: our scenes in its terms, rendered with emitter sampling only.

Variant `llvm_ad_rgb` where an LLVM library is found, else `scalar_rgb`.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from ctypes.util import find_library
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.scene import (
    CheckerboardTexture,
    ConstantTexture,
    Diffuse,
    ImageTexture,
    Mesh,
    PointLight,
    Rectangle,
    Scene,
    Shape,
    Sphere,
    Texture,
)

SAMPLERS = ("independent", "stratified", "multijitter", "ldsampler")
LLVM_VERSIONS = range(22, 10, -1)
_DEFAULT_UVS = np.array([(0, 0), (1, 0), (1, 1)], np.float32)


def _find_llvm() -> None:
    """Tells Dr.Jit, which reads this variable, of the newest LLVM that the usual search finds."""
    found = (find_library(f"LLVM-{version}") for version in LLVM_VERSIONS)
    library = next((name for name in found if name), find_library("LLVM"))
    if library:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", library)


@lru_cache(maxsize=1)
def _module() -> Any:
    """The mitsuba module with its fastest variant that works. Raises ImportError."""
    _find_llvm()
    import mitsuba as mi

    try:
        mi.set_variant("llvm_ad_rgb")
        mi.Float(1.0).numpy()
    except Exception:  # whatever Dr.Jit says where LLVM cannot be loaded
        mi.set_variant("scalar_rgb")
    return mi


def version() -> str | None:
    """Version and variant; None where Mitsuba is not installed."""
    try:
        mi = _module()
    except ImportError:
        return None
    return f"Mitsuba {mi.__version__} {mi.variant()}"


def variant() -> str:
    return str(_module().variant())


def is_vectorised() -> bool:
    return version() is not None and variant() != "scalar_rgb"


def can_express(scene: Scene) -> bool:
    """Whether the direct light of the scene means the same to both renderers: diffuse surfaces only."""
    return all(isinstance(material, Diffuse) for material in scene.materials)


def renderer(scene: Scene, size: tuple[int, int]) -> Callable[[str, int, int], NDArray[np.float32]]:
    """Loads the scene; returns a function of (sampler, spp, seed) → image (height, width, 3), linear Rec.709."""
    mi = _module()
    loaded = mi.load_dict({"type": "scene", **_contents(scene)})
    sensors = {sampler: mi.load_dict(_sensor(scene, size, sampler)) for sampler in SAMPLERS}

    def render(sampler: str, spp: int, seed: int) -> NDArray[np.float32]:
        image = mi.render(loaded, sensor=sensors[sampler], spp=spp, seed=seed)
        return np.array(image, np.float32)

    return render


def ray_scene(vertices: NDArray[np.float64], triangles: NDArray[np.int32], robust: bool = False) -> Any:
    """A scene of one mesh, for ray queries; `robust` sets Embree's flag."""
    mi = _module()
    mesh = _mesh("mesh", vertices, triangles, None, None, {})
    return mi.load_dict({"type": "scene", "mesh": mesh, "embree_use_robust_intersections": robust})


def rays(origins: NDArray[np.float64], directions: NDArray[np.float64], t_max: float = np.inf) -> Any:
    mi = _module()
    import drjit as dr

    ray = mi.Ray3f(mi.Point3f(np.float32(origins.T)), mi.Vector3f(np.float32(directions.T)))
    ray.maxt = mi.Float(float(t_max) if np.isfinite(t_max) else dr.largest(mi.Float))
    dr.eval(ray)
    dr.sync_thread()
    return ray


def closest(scene: Any, ray: Any, coherent: bool = False) -> Any:
    """Traces and waits; the result's `t` and `prim_index` are evaluated, t infinite for a miss."""
    import drjit as dr

    found = scene.ray_intersect_preliminary(ray, coherent=coherent)
    dr.eval(found.t, found.prim_index, found.prim_uv)
    dr.sync_thread()
    return found


def occluded(scene: Any, ray: Any, coherent: bool = False) -> Any:
    import drjit as dr

    found = scene.ray_test(ray, coherent=coherent, active=True)
    dr.eval(found)
    dr.sync_thread()
    return found


def surface(scene: Any, ray: Any) -> Any:
    """The surface interactions of rays, from which `spawn_ray` and `spawn_ray_to` go on."""
    import drjit as dr

    found = scene.ray_intersect(ray)
    dr.eval(found)
    return found


def vectors(values: NDArray[np.float64]) -> Any:
    """(k, 3) as Mitsuba's vectors."""
    return _module().Vector3f(np.float32(values.T))


def write_scene(scene: Scene, size: tuple[int, int], folder: Path) -> Path:
    """Writes scene.xml and its PLY meshes, as a user of Mitsuba would have them; returns the XML's path."""
    mi = _module()
    contents = _contents(scene)
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Mesh):
            path = folder / f"mesh{index}.ply"
            contents[f"shape{index}"].write_ply(str(path))
            flat = {"face_normals": shape.normals is None}  # else Mitsuba would compute some
            contents[f"shape{index}"] = {"type": "ply", "filename": str(path), **flat, **_surface(scene, shape)}
    sensor = _sensor(scene, size, "multijitter")
    whole = {"type": "scene", "sensor": sensor, **contents}
    mi.parser.write_file(mi.parser.parse_dict(mi.parser.ParserConfig(variant()), whole), str(folder / "scene.xml"))
    return folder / "scene.xml"


# Our scene in Mitsuba's terms -----------------------------------------------------------------------------------------


def _sensor(scene: Scene, size: tuple[int, int], sampler: str) -> dict[str, Any]:
    mi, camera = _module(), scene.camera
    reach = float(np.linalg.norm(np.subtract(camera.look_at, camera.position)))
    look = mi.ScalarTransform4f().look_at(origin=list(camera.position), target=list(camera.look_at), up=list(camera.up))
    film = {
        "type": "hdrfilm",
        "width": size[0],
        "height": size[1],
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    return {
        "type": "perspective",
        "fov": camera.fov,
        "fov_axis": "y",
        "to_world": look,
        "film": film,
        "near_clip": 1e-4 * reach,
        "far_clip": 1e6 * reach,
        "sampler": {"type": sampler},
    }


def _contents(scene: Scene) -> dict[str, Any]:
    """Integrator, shapes and lights."""
    contents: dict[str, Any] = {
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0, "hide_emitters": False}
    }
    for index, shape in enumerate(scene.shapes):
        contents[f"shape{index}"] = _shape(scene, shape)
    for index, light in enumerate(scene.lights):
        contents[f"light{index}"] = _point_light(light)
    return contents


def _point_light(light: PointLight) -> dict[str, Any]:
    intensity = [float(flux) / (4 * np.pi) for flux in light.flux]
    return {"type": "point", "position": list(light.position), "intensity": {"type": "rgb", "value": intensity}}


def _shape(scene: Scene, shape: Shape) -> Any:
    mi = _module()
    if isinstance(shape, Mesh):
        corner_uvs = shape.uvs
        if corner_uvs is None and not _is_plain(scene, shape):
            corner_uvs = np.broadcast_to(_DEFAULT_UVS, (len(shape.triangles), 3, 2))
        return _mesh(shape.name, shape.vertices, shape.triangles, shape.normals, corner_uvs, _surface(scene, shape))
    if isinstance(shape, Rectangle):
        e1, e2 = (np.array(edge) / 2 for edge in (shape.edge1, shape.edge2))
        matrix = np.eye(4)
        matrix[:3] = np.stack([e1, e2, np.cross(e1, e2) / np.linalg.norm(np.cross(e1, e2)), shape.center], axis=1)
        return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix), **_surface(scene, shape)}
    assert isinstance(shape, Sphere)
    return {"type": "sphere", "center": list(shape.center), "radius": shape.radius, **_surface(scene, shape)}


def _is_plain(scene: Scene, shape: Shape) -> bool:
    material = None if shape.material is None else scene.materials[shape.material]
    return not isinstance(material, Diffuse) or isinstance(scene.textures[material.texture], ConstantTexture)


def _surface(scene: Scene, shape: Shape) -> dict[str, Any]:
    """BSDF and emitter of a shape."""
    material = None if shape.material is None else scene.materials[shape.material]
    assert material is None or isinstance(material, Diffuse)
    black = {"type": "rgb", "value": [0.0, 0.0, 0.0]}
    reflectance = black if material is None else _texture(scene.textures[material.texture])
    bsdf: dict[str, Any] = {"type": "diffuse", "reflectance": reflectance}
    if material is not None and material.twosided:
        bsdf = {"type": "twosided", "bsdf": bsdf}
    if shape.radiance is None:
        return {"bsdf": bsdf}
    radiance = {"type": "rgb", "value": [float(value) for value in shape.radiance]}
    return {"bsdf": bsdf, "emitter": {"type": "area", "radiance": radiance}}


def _texture(texture: Texture) -> dict[str, Any]:
    mi = _module()
    if isinstance(texture, ConstantTexture):
        return {"type": "rgb", "value": [float(value) for value in texture.color]}
    matrix = np.diag([*texture.scale, 1.0])
    matrix[:2, 2] = texture.delta
    to_uv = mi.ScalarTransform3f(matrix)
    if isinstance(texture, CheckerboardTexture):
        color0, color1 = ({"type": "rgb", "value": list(color)} for color in (texture.color0, texture.color1))
        return {"type": "checkerboard", "to_uv": to_uv, "color0": color0, "color1": color1}
    assert isinstance(texture, ImageTexture)
    return {"type": "bitmap", "bitmap": mi.Bitmap(texture.pixels), "raw": True, "to_uv": to_uv}


def _mesh(
    name: str,
    vertices: NDArray[np.float64],
    triangles: NDArray[np.int32],
    normals: NDArray[np.float32] | None,
    uvs: NDArray[np.float32] | None,
    surface: dict[str, Any],
) -> Any:
    """A Mitsuba mesh; normals and uvs are per corner, and vertices stay shared where corners agree."""
    mi = _module()
    corner = {name: values for name, values in (("normals", normals), ("texcoords", uvs)) if values is not None}
    vertex = {name: _per_vertex(values, triangles, len(vertices)) for name, values in corner.items()}
    if any(values is None for values in vertex.values()):
        vertices = vertices[triangles].reshape(-1, 3)
        triangles = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
        vertex = {name: values.reshape(len(vertices), -1) for name, values in corner.items()}
    properties = mi.Properties()
    for key, plugin in surface.items():
        properties[key] = mi.load_dict(plugin)
    mesh = mi.Mesh(name, len(vertices), len(triangles), properties, "normals" in vertex, "texcoords" in vertex)
    params = mi.traverse(mesh)
    params["vertex_positions"] = np.float32(vertices).ravel()
    params["faces"] = np.uint32(triangles).ravel()
    for key, values in vertex.items():
        params[f"vertex_{key}"] = np.float32(values).ravel()
    params.update()
    return mesh


def _per_vertex(values: NDArray[np.float32], triangles: NDArray[np.int32], count: int) -> NDArray[np.float32] | None:
    """(count, k) values of vertices from those of corners (m, 3, k); None where corners of a vertex disagree."""
    out = np.zeros((count, values.shape[2]), np.float32)
    out[triangles] = values
    return out if (out[triangles] == values).all() else None
