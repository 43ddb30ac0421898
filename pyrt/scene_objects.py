"""The objects of a scene file → shapes, a part of the list at a time: a million of them take little more memory than
their shapes do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pyrt import procedural, scene, schema
from pyrt.geometry import COORDINATE_LIMIT, valid_triangles
from pyrt.loading import Loading
from pyrt.mesh_data import MeshData, instances
from pyrt.mesh_io import load_mesh
from pyrt.schema_errors import quote, validate_objects

_PART = 1 << 12  # objects that are validated at once
_PLACED = 1 << 16  # triangles of instances that are placed at once

Objects = list[tuple[int, schema.ObjectModel]]  # and the index of each in the file


def read_shapes(
    loading: Loading, entries: list[Any], names: Any, materials: Mapping[str, int]
) -> Iterator[scene.Shape]:
    """The shapes of the objects, as far as they have no problems. Empties `entries`, whose memory the shapes take over.

    Args:
        names: materials of the file, valid or not.
        materials: indices of the valid ones in the scene.
    """
    for first in range(0, len(entries), _PART):
        part = slice(first, first + _PART)
        objects, problems = validate_objects(entries[part], first)
        entries[part] = [None] * len(entries[part])
        loading.problems += [f"{loading.place}: {problem}" for problem in problems]
        for index, shape in objects:
            loading.check_name(f"objects[{index}].material_name", "material", shape.material_name, names)
            if isinstance(shape, schema.Icosphere):
                loading.take(f"objects[{index}]", 20 * 4**shape.subdivisions)
        yield from _shapes(loading, objects, materials)


def _shapes(loading: Loading, objects: Objects, materials: Mapping[str, int]) -> Iterator[scene.Shape]:
    meshes = _meshes(loading, objects)
    for index, shape in objects:
        common: dict[str, Any] = {
            "name": f"objects[{index}]",
            # an unknown name is a problem that has been reported
            "material": None if shape.material_name is None else materials.get(shape.material_name, -1),
            "radiance": None if shape.light is None else shape.light.radiance,
        }
        if isinstance(shape, schema.Sphere):
            yield scene.Sphere(center=shape.center, radius=shape.radius, **common)
        elif isinstance(shape, schema.Rectangle):
            yield scene.Rectangle(center=shape.center, edge1=shape.edge1, edge2=shape.edge2, **common)
        elif mesh := _icosphere(shape) if isinstance(shape, schema.Icosphere) else meshes.get(index):
            vertices, triangles, uvs, normals, _ = mesh
            yield scene.Mesh(vertices=vertices, triangles=triangles, uvs=uvs, normals=normals, **common)


def _meshes(loading: Loading, objects: Objects) -> dict[int, MeshData]:
    """Those of the objects that name a file, in their places, by index. Many of one file are placed at once, as numpy
    takes as long for one."""
    runs: dict[tuple[str, bool], list[tuple[int, schema.Mesh]]] = {}
    for index, shape in objects:
        if isinstance(shape, schema.Mesh):
            runs.setdefault((shape.path, shape.transform is None), []).append((index, shape))
    found: dict[int, MeshData] = {}
    for (name, _), run in runs.items():
        mesh = loading.model.meshes.get(name) if loading.model is not None else None
        mesh = mesh or loading.read(f"objects[{run[0][0]}].path", load_mesh, name)
        if mesh is None:
            continue
        step = max(1, _PLACED // max(1, len(mesh.triangles)))
        for first in range(0, len(run), step):
            found |= _placed(loading, mesh, run[first : first + step])
    return found


def _placed(loading: Loading, mesh: MeshData, run: list[tuple[int, schema.Mesh]]) -> dict[int, MeshData]:
    for index, _ in run:
        loading.take(f"objects[{index}]", len(mesh.triangles))
    matrices = [shape.transform for _, shape in run if shape.transform is not None]
    with np.errstate(over="ignore", invalid="ignore"):
        meshes = instances(mesh, np.reshape(matrices, (-1, 4, 4))) if matrices else [mesh] * len(run)
        moves = np.array([[shape.translate] for _, shape in run])
        vertices = (np.stack([of.vertices for of in meshes]) if matrices else mesh.vertices) + moves
    corners = vertices[:, mesh.triangles]
    valid = valid_triangles(corners.reshape(-1, 3, 3)).reshape(corners.shape[:2])
    for index, shape in (run[i] for i in np.flatnonzero(~valid.any(axis=1))):
        found = f"none of the {len(mesh.triangles)} triangles of {quote(shape.path)} has an area"
        loading.problem(f"objects[{index}].path", f"{found} and all its coordinates below {COORDINATE_LIMIT:g}")
    return {index: of._replace(vertices=v) for (index, _), of, v in zip(run, meshes, vertices, strict=True)}


def _icosphere(shape: schema.Icosphere) -> MeshData:
    vertices, triangles = procedural.icosphere(shape.subdivisions)
    if shape.displacement is not None:
        d = shape.displacement
        vertices = vertices * (1 + d.amplitude * procedural.noise(vertices, d.frequency, d.octaves, d.seed)[:, None])
    normals = procedural.vertex_normals(vertices, triangles).astype(np.float32)[triangles] if shape.smooth else None
    return MeshData(vertices * shape.radius + shape.center, triangles, normals=normals)
