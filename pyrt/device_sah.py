"""Binary trees by the surface area heuristic on a device: those of `sah.split`, in a fraction of the time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.layout import aligned_empty, dtypes
from pyrt.sah import BinaryTree, Splitter, split

WORTH_IT = 1 << 16  # primitives from which on the kernel's compilation pays
_WHOLE = 8192  # primitives of a node that one work-item splits to the end


@dataclass
class _Pieces:
    """The tree's nodes as they come: indices in the tree, BuildNode, and the index of the left child or −1."""

    index: list[NDArray[np.int64]] = field(default_factory=list)
    node: list[NDArray[np.void]] = field(default_factory=list)
    left: list[NDArray[np.int64]] = field(default_factory=list)


def splitter(device: Device) -> Splitter:
    """`sah.split` for small scenes, and `device_split` for large ones."""

    def choose(low: NDArray[np.float32], high: NDArray[np.float32], max_depth: int) -> BinaryTree:
        return split(low, high, max_depth) if len(low) < WORTH_IT else device_split(device, low, high, max_depth)

    return choose


def device_split(
    device: Device, low: NDArray[np.float32], high: NDArray[np.float32], max_depth: int, whole: int = _WHOLE
) -> BinaryTree:
    """The tree of `sah.split`, with its arguments and limits, `max_depth` up to BVH_MAX_DEPTH.

    Nodes of more than `whole` primitives are split one a launch and work-item, which changes nothing but the time.

    Raises:
        DeviceError: the kernel does not compile, or the primitives do not fit the device.
    """
    return _tree(*_split(device, low, high, max_depth, whole))


def _split(
    device: Device, low: NDArray[np.float32], high: NDArray[np.float32], max_depth: int, whole: int
) -> tuple[_Pieces, int, NDArray[np.int32]]:
    """The tree's nodes, how many they are, and the primitives in the order of the leaves."""
    n = len(low)
    primitives = aligned_empty(8 * n, np.float32).reshape(n, 8)
    np.negative(low, out=primitives[:, :3])
    primitives[:, 3:6] = high
    ids = primitives.view(np.int32)[:, 6]
    ids[:] = np.arange(n)
    kernel = device.build("build.cl", [])["split_nodes"]
    boxes, scratch, nodes = device.share(primitives), device.allocate(32 * n), device.allocate(64 * n)
    tasks = np.zeros(1, dtypes()["BuildTask"])
    tasks["count"] = n
    pieces, total = _Pieces(), 1
    while len(tasks):
        sizes = device.allocate(4 * len(tasks))
        work = device.upload("tasks", tasks)
        device.run_each(kernel, len(tasks), np.uint32(whole), np.uint32(max_depth), work, boxes, scratch, nodes, sizes)
        with (
            device.mapped(nodes, (2 * n,), dtypes()["BuildNode"]) as found,
            device.mapped(sizes, (len(tasks),), np.uint32) as size,
        ):
            tasks, total = _collect(tasks, found, size.astype(np.int64), whole, pieces, total)
    device.receive(boxes, primitives)
    return pieces, total, ids.copy()


def _collect(
    tasks: NDArray[np.void], found: NDArray[np.void], size: NDArray[np.int64], whole: int, pieces: _Pieces, total: int
) -> tuple[NDArray[np.void], int]:
    """Takes the nodes of a launch. Returns the next tasks, and how many of the tree's nodes have an index by now."""
    once = (tasks["count"] > whole) & (size > 1)
    start = np.cumsum(size) - size
    place = np.arange(size.sum()) - np.repeat(start, size)  # in its task
    node = found[np.repeat(2 * tasks["first"].astype(np.int64), size) + place]
    index = total + np.arange(len(node)) - np.repeat(np.arange(len(tasks)), size) - 1
    index[start] = tasks["node"]
    left = np.where(node["link"] >= 0, node["link"] + np.repeat(total - 1 + start - np.arange(len(tasks)), size), -1)
    done = np.repeat(~once, size) | (place == 0)
    pieces.index.append(index[done])
    pieces.node.append(node[done])
    pieces.left.append(left[done])
    children = np.zeros((np.count_nonzero(once), 2), tasks.dtype)
    children["count"] = node["count"][~done].reshape(-1, 2)
    children["node"] = index[~done].reshape(-1, 2)
    children["first"] = tasks["first"][once, None]
    children["first"][:, 1] += children["count"][:, 0]
    children["depth"] = tasks["depth"][once, None] + 1
    return children.ravel(), total + len(node) - len(tasks)


def _tree(pieces: _Pieces, total: int, ids: NDArray[np.int32]) -> BinaryTree:
    order = np.concatenate(pieces.index)
    node = np.empty(total, dtypes()["BuildNode"])
    left = np.empty(total, np.int32)
    node[order] = np.concatenate(pieces.node)
    left[order] = np.concatenate(pieces.left)
    leaves = np.flatnonzero(left < 0)
    leaves = leaves[np.argsort(~node["link"][leaves])]
    leaf = np.empty(len(ids), np.int32)
    leaf[ids] = np.repeat(leaves, node["count"][leaves])
    children = np.stack([left, np.where(left < 0, left, left + 1)], axis=1)
    return BinaryTree(children, node["count"].astype(np.int32), np.ascontiguousarray(node["box"].T), leaf)
