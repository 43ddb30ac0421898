"""Embree as a peer, through the `embreex` package."""

from __future__ import annotations

from collections.abc import Callable
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray


def version() -> str | None:
    """None where embreex is not installed."""
    try:
        import embreex  # noqa: F401

        return f"embreex {metadata.version('embreex')}"
    except ImportError:
        return None


def ray_scene(vertices: NDArray[np.float64], triangles: NDArray[np.int32], robust: bool = False) -> Any:
    """A committed scene of one mesh."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=robust)
    TriangleMesh(scene, np.float32(vertices), np.int32(triangles))
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # the first query builds the tree
    return scene


def closest(scene: Any) -> Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[Any, Any]]:
    """A function of (origins, directions), both (k, 3) float32, → t (k,), inf for a miss, and triangle (k,), −1."""

    def trace(origins: NDArray[np.float32], directions: NDArray[np.float32]) -> tuple[Any, Any]:
        found = scene.run(origins, directions, query="INTERSECT", output=True)
        return np.where(found["primID"] >= 0, found["tfar"], np.inf), found["primID"]

    return trace


def occluded(scene: Any, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Any:
    """(k,) whether something is in the way."""
    return scene.run(origins, directions, query="OCCLUDED") >= 0
