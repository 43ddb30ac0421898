"""The tree builder: a valid tree for any boxes, of bounded depth, and a good one for ordinary boxes."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

from pyrt import sah
from pyrt.bvh import WIDTH, Bvh, build, collapse
from pyrt.layout import constants
from pyrt.sah import BLOCK_SIZE, BinaryTree, split
from tests.boxes import CASES, Boxes, concentric, equal, line, mixed, needles, nested, sphere, triangles

DEPTH = constants()["BVH_MAX_DEPTH"] - 1


@pytest.fixture(params=CASES, scope="module")
def case(request: pytest.FixtureRequest) -> tuple[Boxes, Bvh]:
    boxes = CASES[request.param]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return boxes, build(*boxes)


def references(bvh: Bvh) -> list[np.ndarray]:
    """The child references of each level, from the root's down."""
    levels = [np.array([bvh.root])]
    while (inner := levels[-1][levels[-1] >= 0]).size:
        used = bvh.bounds[inner, 0, 0] < np.inf
        levels.append(bvh.child[inner][used])
    return levels


def test_every_primitive_is_in_exactly_one_block(case: tuple[Boxes, Bvh]) -> None:
    (low, _), bvh = case
    assert bvh.blocks.shape[1] == WIDTH == BLOCK_SIZE == constants()["BVH_WIDTH"]
    used = bvh.blocks >= 0
    assert used[:, 0].all()
    assert (used[:, :-1] >= used[:, 1:]).all(), "pads come last"
    np.testing.assert_array_equal(np.sort(bvh.blocks[used]), np.arange(len(low)))
    np.testing.assert_array_equal(bvh.blocks[~used], -1)


def test_every_node_and_block_has_one_parent(case: tuple[Boxes, Bvh]) -> None:
    _, bvh = case
    levels = references(bvh)
    found = np.sort(np.concatenate(levels))
    np.testing.assert_array_equal(found, np.arange(-len(bvh.blocks), len(bvh.child)))
    assert len(levels) - 1 == bvh.depth <= DEPTH


def test_bounds_are_exactly_those_of_the_primitives_below(case: tuple[Boxes, Bvh]) -> None:
    (low, high), bvh = case
    block_low = np.where((bvh.blocks >= 0)[..., None], low[bvh.blocks], np.float32(np.inf)).min(axis=1)
    block_high = np.where((bvh.blocks >= 0)[..., None], high[bvh.blocks], np.float32(-np.inf)).max(axis=1)
    node_low, node_high = np.full((len(bvh.child), 3), np.nan), np.full((len(bvh.child), 3), np.nan)
    for level in reversed(references(bvh)):
        for node in level[level >= 0]:
            used = bvh.bounds[node, 0, 0] < np.inf
            child = bvh.child[node, used]
            below = [(node_low[c], node_high[c]) if c >= 0 else (block_low[~c], block_high[~c]) for c in child]
            np.testing.assert_array_equal(bvh.bounds[node][..., used], np.array(below).transpose(2, 1, 0))
            node_low[node], node_high[node] = np.array(below)[:, 0].min(axis=0), np.array(below)[:, 1].max(axis=0)


def test_empty_slots_can_not_be_hit(case: tuple[Boxes, Bvh]) -> None:
    _, bvh = case
    empty = ~(bvh.bounds[:, 0, 0] < np.inf)
    np.testing.assert_array_equal(bvh.bounds[:, :, 0].transpose(0, 2, 1)[empty], np.inf)
    np.testing.assert_array_equal(bvh.bounds[:, :, 1].transpose(0, 2, 1)[empty], -np.inf)
    np.testing.assert_array_equal(bvh.child[empty], 0)
    assert ((~empty).sum(axis=1) >= 2).all()


def test_one_block_needs_no_node() -> None:
    for count in (1, 8):
        bvh = build(*triangles(count, 0.1))
        assert (bvh.root, bvh.depth, len(bvh.blocks), bvh.bounds.shape) == (~0, 0, 1, (0, 3, 2, 8))
    assert build(*triangles(9, 0.1)).root == 0


def test_the_same_boxes_give_the_same_tree() -> None:
    low, high = triangles(20_000, 0.02)
    first, second = build(low, high), build(np.asfortranarray(low), high[::-1].copy()[::-1])
    for name in ("bounds", "child", "blocks"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def leaf_depths(tree: BinaryTree) -> np.ndarray:
    depth = np.zeros(len(tree.count), int)
    nodes = np.zeros(1, int)
    while (nodes := nodes[tree.children[nodes, 0] >= 0]).size:
        depth[tree.children[nodes]] = depth[nodes][:, None] + 1
        nodes = tree.children[nodes].ravel()
    return depth


@pytest.mark.parametrize("boxes", [nested(4000), mixed(4000), needles(4000), equal(4000)])
def test_medians_take_over_where_the_depth_runs_out(boxes: Boxes) -> None:
    """4000 primitives fit into 512 blocks: a depth of 9 is just enough, and allows medians only."""
    for max_depth in (9, 10, 14):
        tree = split(*boxes, max_depth)
        assert leaf_depths(tree).max() <= max_depth
        assert tree.count[tree.children[:, 0] < 0].max() <= BLOCK_SIZE
        assert len(references(collapse(tree))) - 1 <= max_depth
    assert leaf_depths(split(*nested(4000), 50)).max() > DEPTH, "the bound has something to do"


@pytest.mark.slow
@pytest.mark.parametrize("boxes", [equal, concentric, nested])
def test_a_million_boxes_that_no_plane_can_part(boxes: Callable[[int], Boxes]) -> None:
    bvh = build(*boxes(10**6))
    assert bvh.depth <= DEPTH
    np.testing.assert_array_equal(np.sort(bvh.blocks[bvh.blocks >= 0]), np.arange(10**6))


def work(boxes: Boxes) -> float:
    """What building takes, by primitive: levels of the binary tree that look at it, and nodes of either tree."""
    seen = []
    sides = sah._sides

    def count(chunk: sah._Chunk, *rest: int) -> tuple[sah.Bools, sah.Bools]:
        seen.append(len(chunk.ids))
        return sides(chunk, *rest)

    with patch.object(sah, "_sides", count):
        tree = split(*boxes, DEPTH)
    return (sum(seen) + len(tree.count) + WIDTH * len(collapse(tree).child)) / len(boxes[0])


@cache
def work_of_triangles(count: int) -> float:
    return work(triangles(count, count ** (-1 / 3)))


HARD = [equal, concentric, nested, mixed, needles, line]


@pytest.mark.parametrize("boxes", HARD)
@pytest.mark.parametrize("count", [20_000, pytest.param(10**6, marks=pytest.mark.slow)])
def test_hard_boxes_are_at_most_three_times_the_work_of_triangles(boxes: Callable[[int], Boxes], count: int) -> None:
    """N8, counted: a clock would see what else the machine does."""
    assert work(boxes(count)) < 3 * work_of_triangles(count)


def test_splits_of_one_primitive_at_a_time_would_be_far_more_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def one_apart(chunk: sah._Chunk, nodes: sah.Bools, right: sah.Bools) -> None:
        right[np.repeat(nodes, chunk.count)] = True
        right[sah._starts(chunk.count)[nodes]] = False

    monkeypatch.setattr(sah, "_split_at_medians", one_apart)
    assert work(equal(1000)) > 10 * work_of_triangles(1000)


def spread(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Uniformly distributed lines through the sphere of radius 4: origins and directions."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    offset = rng.normal(size=(count, 3))
    offset -= (offset * direction).sum(axis=1, keepdims=True) * direction
    offset *= 4 * np.sqrt(rng.random((count, 1))) / np.linalg.norm(offset, axis=1, keepdims=True)
    return offset - 10 * direction, direction


def hits(origin: np.ndarray, direction: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Whether lines (..., 3) meet boxes (..., 3), in float64."""
    enter = (np.where(direction > 0, low, high) - origin) / direction
    leave = (np.where(direction > 0, high, low) - origin) / direction
    return np.asarray(enter.max(axis=-1) <= leave.min(axis=-1))


def traverse(bvh: Bvh, origin: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, int]:
    """The (line, primitive) pairs of all blocks that lines visit, and the number of visits to nodes and blocks."""
    line, ref = np.arange(len(origin)), np.full(len(origin), bvh.root)
    found, visits = [], len(origin)
    while len(line):
        inner = ref >= 0
        primitive = bvh.blocks[~ref[~inner]]
        found.append(np.stack([np.repeat(line[~inner], WIDTH), primitive.ravel()], axis=1)[primitive.ravel() >= 0])
        line, ref = line[inner], ref[inner]
        box = bvh.bounds[ref].transpose(0, 3, 1, 2).astype(float)
        i, slot = np.nonzero(hits(origin[line][:, None], direction[line][:, None], box[..., 0], box[..., 1]))
        line, ref = line[i], bvh.child[ref[i], slot]
        visits += len(line)
    return np.concatenate(found), visits


@pytest.mark.parametrize("boxes", [triangles(600, 0.1), needles(600), sphere(600), triangles(5, 0.3), nested(600)])
def test_traversal_finds_what_brute_force_finds(boxes: Boxes) -> None:
    low, high = (a.astype(float) for a in boxes)
    origin, direction = spread(np.random.default_rng(7), 2000)
    pairs, _ = traverse(build(*boxes), origin, direction)
    line, primitive = pairs.T
    pairs = pairs[hits(origin[line], direction[line], low[primitive], high[primitive])]
    expected = np.argwhere(hits(origin[:, None], direction[:, None], low, high))
    assert len(expected) > 40
    np.testing.assert_array_equal(pairs[np.lexsort(pairs.T[::-1])], expected)


@pytest.mark.parametrize("boxes", [triangles(2000, 0.03), needles(2000), sphere(2000)])
def test_the_cost_is_the_mean_number_of_visits_of_a_line_through_the_root(boxes: Boxes) -> None:
    bvh = build(*boxes)
    origin, direction = spread(np.random.default_rng(8), 20_000)
    through = hits(origin, direction, boxes[0].min(axis=0).astype(float), boxes[1].max(axis=0).astype(float))
    _, visits = traverse(bvh, origin[through], direction[through])
    assert visits / through.sum() == pytest.approx(bvh.cost, rel=0.03)


def exact_sweep(low: np.ndarray, high: np.ndarray) -> BinaryTree:
    """The greedy SAH with every plane between sorted centers tried, down to blocks."""
    children, count, boxes, leaf = [], [], [], np.zeros(len(low), np.int32)

    def area(boxes: np.ndarray) -> np.ndarray:
        x, y, z = (boxes[:, :3] + boxes[:, 3:]).T
        return np.asarray(x * y + z * (x + y))

    def add(ids: np.ndarray) -> int:
        node = len(count)
        own = np.concatenate([-low[ids], high[ids]], axis=1)
        count.append(len(ids))
        boxes.append(own.max(axis=0))
        children.append((-1, -1))
        leaf[ids] = node
        if len(ids) > BLOCK_SIZE:
            n = np.arange(1, len(ids))
            best = []
            for axis in range(3):
                order = np.argsort(own[:, 3 + axis] - own[:, axis], kind="stable")
                left = area(np.maximum.accumulate(own[order]))[:-1]
                right = area(np.maximum.accumulate(own[order[::-1]]))[-2::-1]
                cost = left * -(-n // BLOCK_SIZE) + right * -(-(len(ids) - n) // BLOCK_SIZE)
                best.append((cost.min(), axis, cost.argmin() + 1, order))
            _, _, middle, order = min(best, key=lambda option: option[:2])
            children[node] = add(ids[order[:middle]]), add(ids[order[middle:]])
        return node

    add(np.arange(len(low)))
    return BinaryTree(np.array(children, np.int32), np.array(count, np.int32), np.array(boxes).T, leaf)


@pytest.mark.parametrize("boxes", [triangles(34, 0.3), triangles(3000, 0.03), needles(3000), sphere(3000)])
def test_the_tree_is_as_good_as_an_exact_sweep(boxes: Boxes, monkeypatch: pytest.MonkeyPatch) -> None:
    exact = collapse(exact_sweep(*boxes)).cost
    assert build(*boxes).cost < 1.02 * exact
    monkeypatch.setattr(sah, "_area", lambda boxes, unit: np.ones_like(boxes[:, 0]))
    assert build(*boxes).cost > 1.2 * exact, "without areas the tree is bad"


def least_cost(tree: BinaryTree) -> float:
    """Of all wide trees made of nodes of the binary tree, by plain recursion."""
    x, y, z = tree.boxes[:3].astype(float) + tree.boxes[3:]
    area = (x * y + z * (x + y)).tolist()

    @cache
    def cover(node: int, slots: int) -> float:
        left, right = tree.children[node].tolist()
        alone = area[node] + (opened(left, right, WIDTH) if tree.count[node] > BLOCK_SIZE else 0)
        return min(alone, opened(left, right, slots)) if left >= 0 else alone

    def opened(left: int, right: int, slots: int) -> float:
        return min((cover(left, k) + cover(right, slots - k) for k in range(1, slots)), default=np.inf)

    return cover(0, 1) / area[0]


@pytest.mark.parametrize("boxes", [triangles(34, 0.3), triangles(1000, 0.2), needles(1000), sphere(1000)])
@pytest.mark.parametrize("gain", [sah.SMALL_GAIN, 100])
def test_no_wide_tree_of_the_same_nodes_costs_less(boxes: Boxes, gain: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if many of the nodes had better stay one block, as they do for a large gain."""
    monkeypatch.setattr(sah, "SMALL_GAIN", gain)
    tree = split(*boxes, DEPTH)
    bvh = collapse(tree)
    extent = (bvh.bounds[:, :, 1] - bvh.bounds[:, :, 0]).astype(float)
    x, y, z = extent.transpose(1, 0, 2)[:, extent[:, 0] >= 0]
    root = boxes[1].max(axis=0).astype(float) - boxes[0].min(axis=0)
    actual = 1 + (x * y + z * (x + y)).sum() / (root[0] * root[1] + root[2] * (root[0] + root[1]))
    assert actual == pytest.approx(bvh.cost, rel=1e-6)
    assert bvh.cost == pytest.approx(least_cost(tree), rel=1e-8)


@pytest.mark.parametrize("boxes", [line(1000), equal(1000), tuple(np.append(a, a[:1] + 1, axis=0) for a in line(1000))])
def test_boxes_without_area_take_few_nodes(boxes: Boxes) -> None:
    bvh = build(*boxes)
    assert len(bvh.child) < len(bvh.blocks) / 4
