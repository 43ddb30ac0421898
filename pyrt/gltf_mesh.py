"""The geometry of a glTF file: its nodes with their places in the world, and triangles of its primitives."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError
from pyrt.files import read_bytes
from pyrt.gltf import Document, at, open_gltf, read_accessor
from pyrt.gltf_schema import Node, Primitive
from pyrt.mesh_data import MeshData, filled_normals, joined, transformed, unit_vectors

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MAX_TRIANGLES = 2**25  # whose 64 bytes each fill a device buffer of 2 GiB
_COLOR_TYPES = ("VEC3", "VEC4")


class PlacedNode(NamedTuple):
    """A node of the scene's tree, and its matrix (4, 4) to the world, for column vectors."""

    number: int
    node: Node
    matrix: NDArray[np.float64]


class PlacedPrimitive(NamedTuple):
    """A primitive of some node's mesh, and its matrix to the world."""

    place: str  # its JSON path
    primitive: Primitive
    matrix: NDArray[np.float64]


def load_gltf_mesh(path: str | os.PathLike[str]) -> MeshData:
    """All triangles of a file's scene as one mesh in the world's space. Raises SceneError as `open_gltf`."""
    content = read_bytes(path)
    try:
        document = open_gltf(path, content)
        placed, warnings = placed_primitives(document, list(placed_nodes(document)))
        primitives = {of.place: of.primitive for of in placed}
        meshes = {place: read_primitive(document, primitive, place)[0] for place, primitive in primitives.items()}
    except SceneError as error:
        raise SceneError([f"{path}: {problem}" for problem in error.problems]) from None
    parts = [transformed(meshes[of.place], of.matrix) for of in placed]
    return joined(parts)._replace(warnings=(*_unused(document), *warnings))


def placed_primitives(document: Document, nodes: list[PlacedNode]) -> tuple[list[PlacedPrimitive], list[str]]:
    """What the nodes show, and warnings about what is left out of that.

    Raises SceneError for more triangles than a device holds, before anything is read.
    """
    found: list[PlacedPrimitive] = []
    warnings: dict[str, None] = {}
    triangles = 0
    for number, node, matrix in nodes:
        if node.extensions.EXT_mesh_gpu_instancing is not None:
            warnings["its EXT_mesh_gpu_instancing is not used, such a node is shown once"] = None
        if node.mesh is None:
            continue
        mesh = at(document.tree.meshes, node.mesh, f"nodes[{number}].mesh", "mesh")
        if not invertible(matrix):
            warnings["its nodes without extent are left out"] = None
            continue
        for i, primitive in enumerate(mesh.primitives):
            place = f"meshes[{node.mesh}].primitives[{i}]"
            if primitive.mode not in (_TRIANGLES, _STRIP, _FAN):
                warnings["its points and lines are not used"] = None
                continue
            triangles += _corner_count(document, primitive, place) // (3 if primitive.mode == _TRIANGLES else 1)
            if triangles > _MAX_TRIANGLES:
                raise SceneError(f"nodes[{number}]: with it the scene has more than {_MAX_TRIANGLES} triangles")
            found.append(PlacedPrimitive(place, primitive, matrix))
            for what, there in (("morph targets", primitive.targets), ("skins", document.tree.skins)):
                if there:
                    warnings[f"its {what} are not used, shapes are as they are stored"] = None
    if document.tree.animations:
        warnings["its animations are not used"] = None
    return found, list(warnings)


def placed_nodes(document: Document) -> Iterator[PlacedNode]:
    """The visible nodes of the file's scene, parents before their children, in the order of the file.

    Raises SceneError for nodes that do not form trees.
    """
    tree = document.tree
    if tree.scenes:
        roots = at(tree.scenes, tree.scene or 0, "scene", "scene").nodes
    else:
        children = {child for node in tree.nodes for child in node.children}
        roots = [index for index in range(len(tree.nodes)) if index not in children]
    waiting = [(index, np.eye(4), "scenes") for index in reversed(roots)]
    seen: set[int] = set()
    while waiting:
        index, above, place = waiting.pop()
        node = at(tree.nodes, index, place, "node")
        if index in seen:
            raise SceneError(f"nodes[{index}]: it is in the scene twice, or above itself")
        seen.add(index)
        if not node.extensions.KHR_node_visibility.visible:
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = above @ _local(node)
        yield PlacedNode(index, node, matrix)
        waiting += [(child, matrix, f"nodes[{index}].children") for child in reversed(node.children)]


def read_primitive(
    document: Document, primitive: Primitive, place: str, texcoord: int = 0
) -> tuple[MeshData, NDArray[np.float64] | None]:
    """The triangles of a primitive, and their linear colours (m, 3, 3), where it has some.

    Raises SceneError for accessors that do not fit each other or the file.
    """
    vertices = _attribute(document, primitive, place, "POSITION", ("VEC3",)).astype(np.float64)
    triangles = _triangles(primitive.mode, _indices(document, primitive, place, len(vertices)))
    mesh = MeshData(vertices, triangles.astype(np.int32))

    def corners(name: str, types: tuple[str, ...]) -> NDArray[np.float64] | None:
        if name not in primitive.attributes:
            return None
        values = _attribute(document, primitive, place, name, types)
        if len(values) != len(vertices):
            raise SceneError(f"{place}.attributes.{name}: {len(values)} values for {len(vertices)} vertices")
        return values.astype(np.float64)[triangles]

    uvs, normals, colors = corners(f"TEXCOORD_{texcoord}", ("VEC2",)), corners("NORMAL", ("VEC3",)), None
    if uvs is not None:
        mesh = mesh._replace(uvs=uvs.astype(np.float32))
    if normals is not None:
        mesh = mesh._replace(normals=filled_normals(unit_vectors(normals), mesh))
    if (rgba := corners("COLOR_0", _COLOR_TYPES)) is not None:
        colors = np.clip(np.nan_to_num(rgba[..., :3]), 0, 1)
    return mesh, colors


def invertible(matrix: NDArray[np.float64]) -> bool:
    """Whether an affine matrix is finite and keeps all three dimensions."""
    return bool(np.isfinite(matrix).all() and np.linalg.matrix_rank(matrix[:3, :3]) == 3)


def _unused(document: Document) -> list[str]:
    tree = document.tree
    unused = [key for key in ("materials", "textures", "cameras") if getattr(tree, key)]
    unused += ["lights"] * ("KHR_lights_punctual" in tree.extensionsUsed)
    return [f"its {' and '.join(unused)} are not used"] if unused else []


def _corner_count(document: Document, primitive: Primitive, place: str) -> int:
    if "POSITION" not in primitive.attributes:
        raise SceneError(f'{place}.attributes: missing key "POSITION"')
    index = primitive.attributes["POSITION"] if primitive.indices is None else primitive.indices
    return at(document.tree.accessors, index, place, "accessor").count


def _local(node: Node) -> NDArray[np.float64]:
    if node.matrix is not None:
        return np.reshape(node.matrix, (4, 4)).T  # stored by columns
    x, y, z, w = np.divide(node.rotation, max(float(np.linalg.norm(node.rotation)), 1e-300))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation * node.scale, node.translation
    return matrix


def _attribute(document: Document, primitive: Primitive, place: str, name: str, types: tuple[str, ...]) -> NDArray[Any]:
    return read_accessor(document, primitive.attributes[name], f"{place}.attributes.{name}", types)


def _indices(document: Document, primitive: Primitive, place: str, count: int) -> NDArray[np.int64]:
    if primitive.indices is None:
        return np.arange(count)
    indices = read_accessor(document, primitive.indices, f"{place}.indices", ("SCALAR",))[:, 0]
    if indices.dtype.kind != "u":
        raise SceneError(f"accessors[{primitive.indices}]: expected unsigned integers as indices")
    if indices.max() >= count:
        raise SceneError(f"{place}.indices: no vertex {indices.max()}, there are {count}")
    return indices.astype(np.int64)


def _triangles(mode: int, indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """(m, 3) corners, in the specification's order for each mode; left-over vertices make no triangle."""
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    i = np.arange(max(len(indices) - 2, 0))
    if mode == _STRIP:
        return indices[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)]
    return indices[np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)]
