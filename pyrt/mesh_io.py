"""Reads triangle meshes: PLY, STL and OFF by trimesh, OBJ, GLB and glTF without it.

A file's parts are joined into one mesh in the file's world space. Texture coordinates are taken as they are stored.
"""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError
from pyrt.files import read_bytes
from pyrt.geometry import parts
from pyrt.image_io import srgb_to_linear
from pyrt.mesh_data import DEFAULT_UVS, MeshData, filled_normals, joined, unit_vectors
from pyrt.mesh_obj import read_obj

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")


class Surfaces(NamedTuple):
    """A mesh and what its file says about the look of it."""

    mesh: MeshData
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) at the corners, linear
    materials: dict[str, NDArray[np.int64]] | None = None  # rows of the triangles of each, "" for those without one
    libraries: tuple[str, ...] = ()  # files that define the materials


def load_mesh(path: str | os.PathLike[str]) -> MeshData:
    """The geometry of a mesh file, as `load_surfaces`; warnings name what else the file holds."""
    surfaces = load_surfaces(path)
    unused = [
        *[f"{path}: its materials are not used"] * any(surfaces.materials or ()),
        *[f"{path}: its colours are not used"] * (surfaces.colors is not None),
    ]
    return surfaces.mesh._replace(warnings=(*unused, *surfaces.mesh.warnings))


def load_surfaces(path: str | os.PathLike[str]) -> Surfaces:
    """Reads a mesh file; its extension tells the format.

    Vertices at equal positions in the file stay bit-equal, so that a closed mesh stays closed. Degenerate triangles and
    non-finite vertices are kept. Where only some parts of a file have texture coordinates, the others get (0,0), (1,0),
    (1,1); where only some have normals, the others are flat. An OBJ file's parts are its triangles.

    Raises:
        SceneError: the file cannot be read, is not of its format, or holds no triangle.
    """
    extension = Path(path).suffix.lower().removeprefix(".")
    if extension not in FORMATS:
        raise SceneError(f"{path}: expected a mesh file ending in {', '.join('.' + f for f in FORMATS)}")
    try:
        with np.errstate(all="ignore"):  # what is not finite is dropped later, and counted
            surfaces = _read(path, extension)
    except SceneError:
        raise
    except Exception as error:  # on malformed files trimesh raises whatever comes up
        told = not isinstance(error, (LookupError, TypeError, AttributeError)) and str(error).strip()
        reason = told.split("\n")[0] if told else "it is damaged"
        raise SceneError(f"{path}: not a readable {extension.upper()} mesh: {reason}") from None
    mesh = surfaces.mesh
    if len(mesh.triangles) == 0:
        raise SceneError(f"{path}: the mesh has no triangle")
    return surfaces._replace(mesh=mesh._replace(warnings=tuple(f"{path}: {warning}" for warning in mesh.warnings)))


def part_of(geometry: Any) -> Surfaces:
    """A trimesh.Trimesh, with normals only if it holds some already."""
    mesh = _mesh(geometry)
    kind = getattr(geometry.visual, "kind", None)
    if kind not in ("vertex", "face"):
        return Surfaces(mesh)
    if kind == "vertex":
        colors = np.asarray(geometry.visual.vertex_colors)[mesh.triangles]
    else:
        colors = np.repeat(np.asarray(geometry.visual.face_colors)[:, None], 3, axis=1)
    return Surfaces(mesh, srgb_to_linear(colors[..., :3] / 255))


def _read(path: str | os.PathLike[str], extension: str) -> Surfaces:
    if extension in ("glb", "gltf"):
        from pyrt.gltf_mesh import load_gltf_mesh  # whose models of glTF take long to import

        return Surfaces(load_gltf_mesh(path))
    content = read_bytes(path)
    return _from_obj(content) if extension == "obj" else _from_trimesh(content, extension)


def _from_obj(content: bytes) -> Surfaces:
    data = read_obj(content)
    triangles, uv_index, normal_index = data.corners.transpose(2, 0, 1)
    has_uvs, has_normals = ((index >= 0).all(axis=1)[:, None, None] for index in (uv_index, normal_index))
    mesh = MeshData(data.positions, triangles.astype(np.int32), warnings=data.warnings)
    if has_uvs.any():
        uvs = np.where(has_uvs, data.uvs[uv_index], DEFAULT_UVS)
        mesh = mesh._replace(uvs=uvs.astype(np.float32))
    if has_normals.any():
        normals = np.where(has_normals, unit_vectors(data.normals)[normal_index], np.nan)
        mesh = mesh._replace(normals=filled_normals(normals, mesh))
    colors = None if data.colors is None else srgb_to_linear(data.colors)[mesh.triangles]
    return Surfaces(mesh, colors, data.materials, data.libraries)


def _from_trimesh(content: bytes, extension: str) -> Surfaces:
    from trimesh import Trimesh, load_scene

    if extension == "stl":
        _check_stl(content)
    scene = load_scene(io.BytesIO(content), extension, process=False, skip_materials=True)
    parts = [part_of(geometry) for geometry in scene.geometry.values() if isinstance(geometry, Trimesh)]
    warnings = ("its points and lines are not used",) * (len(parts) < len(scene.geometry))
    colors = [part.colors for part in parts if part.colors is not None]
    mesh = joined([part.mesh for part in parts])._replace(warnings=warnings)
    return Surfaces(mesh, np.concatenate(colors) if len(colors) == len(parts) > 0 else None)


def _check_stl(content: bytes) -> None:
    """Raises ValueError for a binary file of another length than its header says, which trimesh would take for text."""
    count, there = int.from_bytes(content[80:84], "little"), (len(content) - 84) // 50
    if count != there and b"\0" in content[:84]:
        raise ValueError(f"its header says {count} triangles, the file has room for {max(there, 0)}")


def _mesh(geometry: Any) -> MeshData:
    vertices = np.array(geometry.vertices, np.float64)
    triangles = np.array(geometry.faces, np.int32).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(f"a face refers to a vertex that is not there, there are {len(vertices)}")
    mesh = MeshData(vertices, triangles)
    uvs = getattr(geometry.visual, "uv", None)
    if uvs is not None:
        mesh = mesh._replace(uvs=np.asarray(uvs, np.float32)[triangles])
    # trimesh computes normals that are asked for; only those from the file are in its cache by now
    if "vertex_normals" in geometry._cache:
        mesh = mesh._replace(
            normals=_corner_normals(unit_vectors(np.asarray(geometry.vertex_normals, np.float64)), mesh)
        )
    return mesh


def _corner_normals(normals: NDArray[np.float64], mesh: MeshData) -> NDArray[np.float32]:
    """(m, 3, 3) from those of the vertices; in parts, since their float64 takes more memory than all of the mesh."""
    out = np.empty((len(mesh.triangles), 3, 3), np.float32)
    for part in parts(len(out)):
        triangles = mesh.triangles[part]
        out[part] = filled_normals(normals[triangles], MeshData(mesh.vertices, triangles))
    return out
