"""The tree builder on the device: the trees of the one in numpy, whatever the boxes, the depth and the cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pyrt import device_sah
from pyrt.bvh import Bvh, collapse
from pyrt.device import Device
from pyrt.device_sah import device_split
from pyrt.layout import constants
from pyrt.sah import BLOCK_SIZE, BinaryTree, split
from tests.boxes import CASES, Boxes, concentric, equal, mixed, needles, nested, triangles

DEPTH = constants()["BVH_MAX_DEPTH"] - 1


@pytest.fixture(scope="module")
def device() -> Device:
    return Device()


def assert_same(tree: BinaryTree, other: BinaryTree) -> None:
    """Same nodes, which may be numbered otherwise, and the same wide tree, bit for bit."""
    a, b = np.zeros(1, int), np.zeros(1, int)
    while len(a):
        np.testing.assert_array_equal(tree.count[a], other.count[b])
        np.testing.assert_array_equal(tree.boxes[:, a], other.boxes[:, b])
        inner = tree.children[a, 0] >= 0
        np.testing.assert_array_equal(inner, other.children[b, 0] >= 0)
        a, b = tree.children[a[inner]].ravel(), other.children[b[inner]].ravel()
    wide, other_wide = collapse(tree), collapse(other)
    for name in ("bounds", "child", "blocks"):
        np.testing.assert_array_equal(getattr(wide, name), getattr(other_wide, name))


@pytest.mark.parametrize("name", CASES)
def test_the_tree_is_the_one_that_numpy_builds(name: str, device: Device) -> None:
    boxes = CASES[name]
    least_depth = max(int(np.ceil(np.log2(len(boxes[0]) / BLOCK_SIZE))), 0)
    for max_depth in {DEPTH, least_depth, least_depth + 1}:
        expected = split(*boxes, max_depth)
        for whole in (0, 100, 10**6):
            assert_same(device_split(device, *boxes, max_depth, whole), expected)


def test_another_tree_is_seen(device: Device) -> None:
    boxes = triangles(500, 0.1)
    with pytest.raises(AssertionError):
        assert_same(device_split(device, *boxes, DEPTH), split(*boxes, 6))


def test_large_scenes_are_split_on_the_device_and_small_ones_are_not(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[int] = []

    def noted(device: Device, *boxes: np.ndarray, **rest: int) -> BinaryTree:
        used.append(len(boxes[0]))
        return device_split(device, *boxes, **rest)

    monkeypatch.setattr(device_sah, "device_split", noted)
    monkeypatch.setattr(device_sah, "WORTH_IT", 100)
    choose = device_sah.splitter(device)
    for count in (99, 100):
        assert_same(choose(*triangles(count, 0.1), DEPTH), split(*triangles(count, 0.1), DEPTH))
    assert used == [100]


@pytest.mark.slow
@pytest.mark.parametrize("boxes", [equal, concentric, nested, mixed, needles])
def test_a_million_hard_boxes(boxes: Callable[[int], Boxes], device: Device) -> None:
    low, high = boxes(10**6)
    bvh: Bvh = collapse(device_split(device, low, high, DEPTH))
    assert bvh.depth <= DEPTH
    np.testing.assert_array_equal(np.sort(bvh.blocks[bvh.blocks >= 0]), np.arange(10**6))
