"""Bounding volume hierarchies of 8-wide nodes over blocks of up to 8 primitives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.layout import constants
from pyrt.sah import BLOCK_SIZE, BinaryTree, Splitter, split

WIDTH = BLOCK_SIZE  # a node has as many children as a block has primitives
TINY_AREA = 1e-9  # least area of a box, in areas of the root: where there is no area, the fewest nodes are best


@dataclass(frozen=True)
class Bvh:
    """The tree as arrays. A child reference is an inner node's index if >= 0, else ~block.

    Attributes:
        bounds: (nodes, 3, 2, 8): [axis][low, high][child]. An empty slot has low = +inf, high = -inf.
        child: (nodes, 8): child references; 0 in empty slots.
        blocks: (blocks, 8): primitives, padded with -1 at the end.
        root: child reference of the root.
        depth: levels of inner nodes.
        cost: nodes and blocks that a random line through the root's box is expected to visit (surface area heuristic).
    """

    bounds: NDArray[np.float32]
    child: NDArray[np.int32]
    blocks: NDArray[np.int32]
    root: int
    depth: int
    cost: float


def build(low: NDArray[np.float32], high: NDArray[np.float32], splitter: Splitter = split) -> Bvh:
    """The tree over n >= 1 primitives with finite bounds (n, 3), |x| < 2^125. The same bounds give the same tree."""
    # One level is left for a root above two trees.
    return collapse(splitter(low, high, constants()["BVH_MAX_DEPTH"] - 1))


def collapse(tree: BinaryTree) -> Bvh:
    """The 8-wide tree of least cost whose nodes and blocks are nodes of the binary `tree`; not deeper than that."""
    levels = _levels(tree.children)
    plan = _plan(tree, levels)
    bounds, child, block_nodes = _wide_nodes(tree, plan)
    blocks = _blocks(tree, levels, block_nodes)
    empty_bounds, empty_child = np.empty((0, 3, 2, WIDTH), np.float32), np.empty((0, WIDTH), np.int32)
    return Bvh(
        np.concatenate([empty_bounds, *bounds]),
        np.concatenate([empty_child, *child]),
        blocks,
        root=0 if child else ~0,
        depth=len(child),
        cost=float(plan.cost[0, 0]),
    )


@dataclass(frozen=True)
class _Plan:
    """How to fill the slots of wide nodes with nodes of a binary tree at the least cost.

    After Ylitie et al., "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs" (2017), section 3.2:
    `cost[k, i]` is the least cost of covering binary node k with at most i + 1 slots. If that takes more than one slot,
    `left[k, i]` of them go to the left child.
    """

    cost: NDArray[np.float64]  # (m, 8)
    left: NDArray[np.int8]  # (m, 8)


def _levels(children: NDArray[np.int32]) -> list[NDArray[np.int32]]:
    """The inner nodes of each depth."""
    levels: list[NDArray[np.int32]] = []
    nodes = np.zeros(1, np.int32)
    while True:
        nodes = nodes[children[nodes, 0] >= 0]
        if not len(nodes):
            return levels
        levels.append(nodes)
        nodes = children[nodes].ravel()


def _plan(tree: BinaryTree, levels: list[NDArray[np.int32]]) -> _Plan:
    x, y, z = tree.boxes[:3].astype(np.float64) + tree.boxes[3:]
    area = x * y + z * (x + y)
    area = np.maximum(area / area[0], TINY_AREA) if area[0] > 0 else np.ones_like(area)
    cost = np.repeat(area[:, None], WIDTH, axis=1)
    left = np.zeros((len(area), WIDTH), np.int8)
    for nodes in reversed(levels):
        a, b = (np.ascontiguousarray(cost[child].T) for child in tree.children[nodes].T)
        least, first = a[0] + b, np.ones(b.shape, np.int8)  # of i + 2 slots, and how many of them are the left child's
        for i in range(1, WIDTH - 1):
            for k in range(1, i + 1):
                option = a[k] + b[i - k]
                better = option < least[i]
                np.copyto(least[i], option, where=better)
                np.copyto(first[i], k + 1, where=better)
        fits = tree.count[nodes] <= WIDTH
        own = np.where(fits, area[nodes], area[nodes] + least[WIDTH - 2])
        cost[nodes, 0] = own
        cost[nodes, 1:] = np.minimum(least[:-1], own).T
        left[nodes, 1:] = first[:-1].T
    return _Plan(cost, left)


def _open(tree: BinaryTree, plan: _Plan, nodes: NDArray[np.int32]) -> NDArray[np.int32]:
    """The binary nodes in the slots of the wide nodes (len(nodes), 8); -1 where a slot is empty."""
    slots = np.full((len(nodes), WIDTH), -1, np.int32)
    row = np.arange(len(nodes))
    first = np.zeros(len(nodes), np.int64)
    room = np.full(len(nodes), WIDTH)
    while len(nodes):
        left = plan.left[nodes, room - 1]
        nodes = tree.children[nodes].T.ravel()
        row, first, room = np.tile(row, 2), np.concatenate([first, first + left]), np.concatenate([left, room - left])
        slots[row, first] = nodes
        more = plan.cost[nodes, room - 1] < plan.cost[nodes, 0]
        row, first, room, nodes = row[more], first[more], room[more], nodes[more]
    return slots


def _wide_nodes(
    tree: BinaryTree, plan: _Plan
) -> tuple[list[NDArray[np.float32]], list[NDArray[np.int32]], NDArray[np.int32]]:
    """Bounds and children of the wide nodes, level by level, and the binary node of each block."""
    count = np.append(tree.count, 0)  # for slot -1
    boxes = np.append(tree.boxes, np.full((6, 1), -np.inf, np.float32), axis=1)
    bounds, children, blocks = [], [], [np.zeros(int(count[0] <= WIDTH), np.int32)]
    nodes = np.zeros(int(count[0] > WIDTH), np.int32)
    node_total, block_total = 1, 0
    while len(nodes):
        slots = _open(tree, plan, nodes)
        # Any hit takes the last first: the fewest primitives, which are often large, and soon tested.
        slots = np.take_along_axis(slots, np.argsort(-count[slots], axis=1, kind="stable"), axis=1)
        box = boxes[:, slots].reshape(2, 3, len(nodes), WIDTH).transpose(2, 1, 0, 3)
        bounds.append(box * np.array([[-1], [1]], np.float32))
        inner, block = count[slots] > WIDTH, (slots >= 0) & (count[slots] <= WIDTH)
        nodes = slots[inner]
        blocks.append(slots[block])
        child = np.zeros(slots.shape, np.int32)
        child[inner] = node_total + np.arange(len(nodes))
        child[block] = ~(block_total + np.arange(len(blocks[-1])))
        children.append(child)
        node_total += len(nodes)
        block_total += len(blocks[-1])
    return bounds, children, np.concatenate(blocks)


def _blocks(tree: BinaryTree, levels: list[NDArray[np.int32]], block_nodes: NDArray[np.int32]) -> NDArray[np.int32]:
    """The primitives below each of `block_nodes`."""
    block = np.full(len(tree.count), -1, np.int32)
    block[block_nodes] = np.arange(len(block_nodes))
    for nodes in levels:
        covered = nodes[block[nodes] >= 0]
        block[tree.children[covered]] = block[covered][:, None]
    order = np.argsort(block[tree.leaf], kind="stable")
    blocks = np.full((len(block_nodes), WIDTH), -1, np.int32)
    blocks[np.arange(WIDTH) < tree.count[block_nodes][:, None]] = order
    return blocks
