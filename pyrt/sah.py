"""Binary trees by the binned surface area heuristic (SAH).

After Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies" (2007): n primitives cost the surface area
of their box times ceil(n / 8), because the device tests blocks of 8 at once. Whole chunks of nodes are split at a time,
each node at the best of the planes between bins on three axes. kernels/build.cl does the same for large scenes.

A box is six numbers, -low and high: so the union of boxes is one maximum, and their extent one sum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

BLOCK_SIZE = 8
SIZE_CLASSES = (BLOCK_SIZE, 32)  # nodes of up to 8 primitives and of up to 32 are split apart from larger ones
BINS = (8, 16, 32)  # of each class
CHUNK_NODES = 1024  # nodes split at once: few enough for their bins to stay in the cache
SMALL_GAIN = 0.8  # a node that fits a block is split if its parts have less than this much of its area
BALANCE = np.float32(1e-5)  # weight of the difference in count, to decide between planes of equal cost


@dataclass(frozen=True)
class BinaryTree:
    """`m` nodes over `n` primitives. Node 0 is the root."""

    children: NDArray[np.int32]  # (m, 2): -1 in leaves
    count: NDArray[np.int32]  # (m,): primitives below
    boxes: Floats  # (6, m): -low, high
    leaf: NDArray[np.int32]  # (n,): the leaf of each primitive


Splitter = Callable[[Floats, Floats, int], BinaryTree]  # with the arguments of `split`, and the same tree


@dataclass(frozen=True)
class _Chunk:
    """Nodes of one size class. Each owns the next `count` primitives of the chunk."""

    boxes: Floats  # (6, primitives): -low, high
    ids: NDArray[np.int32]  # (primitives,)
    node: Ints  # (nodes,)
    count: Ints  # (nodes,)
    depth: Ints  # (nodes,)


@dataclass(frozen=True)
class _Planes:
    """One plane for each node: primitives in bins above `last` lie on its right."""

    axis: Ints
    low: Floats  # bounds of the node's positions on that axis
    extent: Floats  # never 0
    last: Ints
    gain: Bools  # worth it even for a node that fits a block


def split(low: Floats, high: Floats, max_depth: int) -> BinaryTree:
    """Splits n primitives into leaves of at most 8, none of them deeper than `max_depth` (the root has depth 0).

    Args:
        low, high: (n, 3) bounds, |x| < 2^125; 1 <= n <= 8 * 2^max_depth.
        max_depth: at most 50. Exact median splits replace the SAH where the depth would run out.
    """
    n = len(low)
    leaf = np.zeros(n, np.int32)
    zero = np.zeros(1, np.int64)
    boxes = np.concatenate([-low.T, high.T]).astype(np.float32, copy=False)
    waiting: list[list[_Chunk]] = [[] for _ in BINS]
    waiting[np.searchsorted(SIZE_CLASSES, n)].append(_Chunk(boxes, np.arange(n, dtype=np.int32), zero, zero + n, zero))
    seen: list[tuple[Ints, Ints, Floats]] = []
    parents: list[Ints] = []
    total = 1
    for size_class in reversed(range(len(BINS))):
        while waiting[size_class]:
            chunks, waiting[size_class] = _regroup(waiting[size_class]), []
            for chunk in chunks:
                seen.append((chunk.node, chunk.count, np.maximum.reduceat(chunk.boxes, _starts(chunk.count), axis=1)))
                right, inner = _sides(chunk, size_class, max_depth)
                if size_class == 0:
                    leaf[chunk.ids] = np.repeat(chunk.node, chunk.count)
                parents.append(chunk.node[inner])
                for k, child in _children(chunk, right, inner, total):
                    waiting[k].append(child)
                total += 2 * len(parents[-1])
    return _assemble(total, seen, parents, leaf)


def _assemble(
    total: int, seen: list[tuple[Ints, Ints, Floats]], parents: list[Ints], leaf: NDArray[np.int32]
) -> BinaryTree:
    children = np.full((total, 2), -1, np.int32)
    first = 1
    for parent in parents:
        children[parent] = first + np.arange(2 * len(parent)).reshape(2, -1).T
        first += 2 * len(parent)
    node, count, boxes = (np.concatenate(pieces, axis=-1) for pieces in zip(*seen, strict=True))
    order = np.empty_like(node)
    order[node] = np.arange(total)
    return BinaryTree(children, count[order].astype(np.int32), boxes.take(order, axis=1), leaf)


def _starts(count: Ints) -> Ints:
    return np.cumsum(count) - count


def _regroup(chunks: list[_Chunk]) -> list[_Chunk]:
    """The same nodes in chunks of CHUNK_NODES."""
    boxes = np.concatenate([chunk.boxes for chunk in chunks], axis=1)
    ids = np.concatenate([chunk.ids for chunk in chunks])
    node = np.concatenate([chunk.node for chunk in chunks])
    count = np.concatenate([chunk.count for chunk in chunks])
    depth = np.concatenate([chunk.depth for chunk in chunks])
    ends = np.append(_starts(count), len(ids))
    pieces = []
    for first in range(0, len(node), CHUNK_NODES):
        part = slice(first, first + CHUNK_NODES)
        own = slice(ends[first], ends[min(first + CHUNK_NODES, len(node))])
        pieces.append(_Chunk(boxes[:, own], ids[own], node[part], count[part], depth[part]))
    return pieces


def _children(chunk: _Chunk, right: Bools, inner: Bools, first: int) -> list[tuple[int, _Chunk]]:
    """The children of the `inner` nodes, by size class. Numbers begin at `first`: the left children, then the right."""
    on_right = np.add.reduceat(right, _starts(chunk.count), dtype=np.int64)
    count = np.stack([chunk.count - on_right, on_right])
    node = np.zeros_like(count)
    node[:, inner] = first + np.arange(2 * np.count_nonzero(inner)).reshape(2, -1)
    size_class = np.searchsorted(SIZE_CLASSES, count)
    chunks = []
    for k in range(len(BINS)):
        mask = inner & (size_class == k)
        if mask.any():
            in_left, in_right = np.repeat(mask, chunk.count, axis=1)
            index = np.concatenate([np.flatnonzero(in_left & ~right), np.flatnonzero(in_right & right)])
            depth = np.broadcast_to(chunk.depth + 1, mask.shape)[mask]
            child = _Chunk(chunk.boxes.take(index, axis=1), chunk.ids[index], node[mask], count[mask], depth)
            chunks.append((k, child))
    return chunks


def _sides(chunk: _Chunk, size_class: int, max_depth: int) -> tuple[Bools, Bools]:
    """Whether each primitive goes to the right, and whether each node is split at all."""
    planes = _best_planes(chunk, BINS[size_class])
    n = len(chunk.ids)
    index = np.repeat(planes.axis * n, chunk.count) + np.arange(n)
    values = chunk.boxes.ravel()
    position = values.take(index + 3 * n) - values.take(index)
    bins = _bins(position, chunk.count, planes.low, planes.extent, BINS[size_class])
    right = bins > np.repeat(planes.last, chunk.count)
    on_right = np.add.reduceat(right, _starts(chunk.count), dtype=np.int64)
    larger = np.maximum(on_right, chunk.count - on_right)
    room = (BLOCK_SIZE << max_depth) >> (chunk.depth + 1)
    bad = (larger == chunk.count) | (larger > room)
    if size_class == 0:
        return right, planes.gain & ~bad & (chunk.depth < max_depth)
    if bad.any():
        _split_at_medians(chunk, bad, right)
    return right, np.ones_like(bad)


def _split_at_medians(chunk: _Chunk, nodes: Bools, right: Bools) -> None:
    """Overwrites `right` for `nodes`: halves by position on the widest axis; where positions are equal, by index."""
    index = np.flatnonzero(np.repeat(nodes, chunk.count))
    count = chunk.count[nodes]
    start = _starts(count)
    position = chunk.boxes[3:, index] - chunk.boxes[:3, index]
    extent = np.maximum.reduceat(position, start, axis=1) - np.minimum.reduceat(position, start, axis=1)
    key = np.choose(np.repeat(extent.argmax(axis=0), count), position)
    order = np.lexsort((key, np.repeat(np.arange(len(count)), count)))
    half = -(-count // (2 * BLOCK_SIZE)) * BLOCK_SIZE
    right[index[order]] = np.arange(len(index)) >= np.repeat(start + half, count)


def _bins(position: Floats, count: Ints, low: Floats, extent: Floats, bins: int) -> Ints:
    """The bin of each position in its node's interval, [low, low + extent]; the first or the last one outside of it."""
    with np.errstate(over="ignore"):
        scaled = position - np.repeat(low, count)
        scaled /= np.repeat(extent, count)
        scaled *= np.float32(bins)
    return np.clip(scaled, 0, bins - 1, out=scaled).astype(np.int64)


def _best_planes(chunk: _Chunk, bins: int) -> _Planes:
    m = len(chunk.node)
    start = _starts(chunk.count)
    position = chunk.boxes[3:] - chunk.boxes[:3]
    low = np.minimum.reduceat(position, start, axis=1)
    extent = np.maximum.reduceat(position, start, axis=1) - low
    extent[extent == 0] = 1
    node = np.repeat(np.arange(m), chunk.count)
    boxes = np.full((3, 6, bins * m), -np.inf, np.float32)
    counts = np.empty((3, bins * m), np.float32)
    for axis in range(3):
        cell = _bins(position[axis], chunk.count, low[axis], extent[axis], bins) * m + node
        for k in range(6):
            np.maximum.at(boxes[axis, k], cell, chunk.boxes[k])
        counts[axis] = np.bincount(cell, minlength=bins * m)
    cost, area = _sweep(boxes.reshape(3, 6, bins, m), counts.reshape(3, bins, m))
    cost = cost.reshape(-1, m)
    best = cost.argmin(axis=0)
    axis, last = np.divmod(best, bins - 1)
    each = np.arange(m)
    return _Planes(axis, low[axis, each], extent[axis, each], last, cost[best, each] < SMALL_GAIN * area)


def _sweep(left: Floats, count: Floats) -> tuple[Floats, Floats]:
    """SAH cost of every plane, (3, bins - 1, nodes), and the nodes' areas, (nodes,). Overwrites its arguments.

    Areas are relative to the square of the node's largest extent, so that they neither overflow nor underflow.
    """
    right = left.copy()
    for k in range(1, left.shape[2]):
        np.maximum(left[:, :, k], left[:, :, k - 1], out=left[:, :, k])
        np.maximum(right[:, :, -1 - k], right[:, :, -k], out=right[:, :, -1 - k])
        count[:, k] += count[:, k - 1]
    total = count[:, -1:]
    on_left, on_right = count[:, :-1], total - count[:, :-1]
    unit = (left[0, :3, -1] + left[0, 3:, -1]).max(axis=0)
    unit[unit == 0] = 1
    cost = _area(left[:, :, :-1], unit) * _blocks(on_left) + _area(right[:, :, 1:], unit) * _blocks(on_right)
    cost += np.abs(on_left - on_right) * (BALANCE / total)
    return cost, _area(left[:1, :, -1], unit)[0]


def _area(boxes: Floats, unit: Floats) -> Floats:
    """Half the surface of (3, 6, ...) boxes in units of unit^2; inf for the box of nothing."""
    extent = boxes[:, :3] + boxes[:, 3:]
    extent /= unit
    x, y, z = extent[:, 0], extent[:, 1], extent[:, 2]
    area: Floats = x * y + z * (x + y)
    return area


def _blocks(count: Floats) -> Floats:
    """Blocks for `count` primitives; at least 1, so that a side of nothing costs infinity."""
    blocks: Floats = np.maximum(np.ceil(count * np.float32(1 / BLOCK_SIZE)), 1)
    return blocks
