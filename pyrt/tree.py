"""The BVH over all primitives, as the arrays that the kernels traverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.bvh import Bvh, build
from pyrt.geometry import extremes, parts
from pyrt.layout import aligned_empty, constants, dtypes
from pyrt.sah import Splitter, split

_ULP = 2.0**-24


@dataclass(frozen=True)
class Tree:
    """Arrays of BvhNode, TriangleBlock and SphereBlock, the root's child reference, and the levels of nodes."""

    nodes: NDArray[Any]
    triangle_blocks: NDArray[Any]
    sphere_blocks: NDArray[Any]
    root: int
    depth: int


def build_tree(corners: NDArray[np.float32], spheres: NDArray[Any], splitter: Splitter = split) -> Tree:
    """One tree over (m, 3, 3) triangles and an array of Sphere: a tree of each, under a common root if there are both.

    Triangles are primitives 0 … m − 1, spheres follow.
    """
    kinds = constants()
    trees: list[_Part] = []
    triangle_blocks = np.empty(0, dtypes()["TriangleBlock"])
    sphere_blocks = np.empty(0, dtypes()["SphereBlock"])
    if len(corners):
        part = _part(*_triangle_bounds(corners), kinds["BLOCK_TRIANGLES"], splitter)
        triangle_blocks = _triangle_blocks(corners, part.tree.blocks)
        trees.append(part)
    if len(spheres):
        part = _part(*_sphere_bounds(spheres), kinds["BLOCK_SPHERES"], splitter)
        sphere_blocks = _sphere_blocks(spheres, part.tree.blocks, len(corners))
        trees.append(part)
    nodes, root, depth = _join(trees)
    return Tree(nodes, triangle_blocks, sphere_blocks, root, depth)


@dataclass(frozen=True)
class _Part:
    tree: Bvh
    kind: int  # of its blocks
    extent: NDArray[np.float32]  # (axis, [low, high])


def _part(low: NDArray[np.float32], high: NDArray[np.float32], kind: int, splitter: Splitter) -> _Part:
    return _Part(build(low, high, splitter), kind, np.stack([extremes(low)[0], extremes(high)[1]], axis=1))


def _join(trees: list[_Part]) -> tuple[NDArray[Any], int, int]:
    """Nodes, root reference and depth of the parts together."""
    count = sum(len(part.tree.child) for part in trees)
    nodes = aligned_empty(count + (len(trees) != 1), dtypes()["BvhNode"])
    nodes["unused"] = 0
    roots: list[int] = []
    first = 0
    for part in trees:
        mine = nodes[first : first + len(part.tree.child)]
        mine["bounds"] = part.tree.bounds
        mine["child"] = _reference(part.tree.child, part.kind, first)
        roots.append(int(_reference(np.array(part.tree.root), part.kind, first)))
        first += len(mine)
    depth = max((part.tree.depth for part in trees), default=0)
    if len(trees) == 1:
        return nodes, roots[0], depth
    top = nodes[count]  # of an empty scene: a root without children
    top["bounds"][:, 0], top["bounds"][:, 1], top["child"] = np.inf, -np.inf, 0
    for slot, (part, root) in enumerate(zip(trees, roots, strict=True)):
        top["bounds"][:, :, slot] = part.extent
        top["child"][slot] = root
    return nodes, count, depth + 1


def _reference(child: NDArray[np.int32], kind: int, first: int) -> NDArray[np.int32]:
    """The kernels' child reference: inner nodes count on from `first`, a leaf also tells the kind of its block."""
    return np.where(child >= 0, child + first, ~(2 * ~child + kind)).astype(np.int32)


def _triangle_bounds(corners: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    a, b, c = corners.transpose(1, 0, 2)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _triangle_blocks(corners: NDArray[np.float32], blocks: NDArray[np.int32]) -> NDArray[Any]:
    out = aligned_empty(len(blocks), dtypes()["TriangleBlock"])
    out["id"] = blocks
    for part in parts(len(blocks)):
        lanes = corners[blocks[part]]  # (blocks, 8, corner, axis)
        lanes[blocks[part] < 0] = np.nan
        out["vertex"][part] = lanes.transpose(0, 2, 3, 1)
    return out


def _sphere_bounds(spheres: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    reach = spheres["radius"][:, None] * np.float32(1 + 4 * _ULP) + np.abs(spheres["center"]) * np.float32(2 * _ULP)
    return spheres["center"] - reach, spheres["center"] + reach


def _sphere_blocks(spheres: NDArray[Any], blocks: NDArray[np.int32], first_id: int) -> NDArray[Any]:
    out = np.empty(len(blocks), dtypes()["SphereBlock"])
    out["center"] = spheres["center"][blocks].transpose(0, 2, 1)
    out["radius"] = np.where(blocks < 0, np.nan, spheres["radius"][blocks])
    out["id"] = np.where(blocks < 0, -1, blocks + first_id)
    return out
