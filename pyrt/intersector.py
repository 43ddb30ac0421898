"""Ray queries on a trimesh mesh: a drop-in for trimesh's own engines."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.tracer import RayTracer

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class RayMeshIntersector:
    """Answers like `trimesh.ray.ray_pyembree.RayMeshIntersector`: same methods, shapes, dtypes and order of hits.

        mesh.ray = pyrt.RayMeshIntersector(mesh)

    Then `mesh.contains`, `trimesh.proximity.signed_distance`, `trimesh.sample.volume_mesh` and the like use it too. A
    changed mesh is noticed at the next query, as there: by its hash.

    It differs where float32 and steps past the last hit make Embree's answers miss something: no ray slips through an
    edge or a corner, hits may lie any distance apart, and each passage through the surface is one hit, also at an edge
    (see `RayTracer.all_hits`). Hits lie at a distance > 0 from the origin. Rays that are not finite, or have no
    direction, hit nothing.

    Args:
        geometry: a `trimesh.Trimesh`.
        scale_to_box: there for trimesh's callers; a mesh of any size and place is normalised, and exactly, in any case.
        device: index or part of the name of an OpenCL device; None chooses.
    """

    def __init__(self, geometry: Any, scale_to_box: bool = True, device: str | int | None = None):
        self.mesh = geometry
        self._device = device
        self._built: tuple[int, RayTracer] | None = None

    @property
    def tracer(self) -> RayTracer:
        """The tracer of the mesh as it is now."""
        key = hash(self.mesh)
        if self._built is None or self._built[0] != key:
            self._built = key, RayTracer(self.mesh.vertices, self.mesh.faces, self._device)
        return self._built[1]

    def intersects_location(
        self, ray_origins: ArrayLike, ray_directions: ArrayLike, multiple_hits: bool = True
    ) -> tuple[Floats, Ints, Ints]:
        """Where rays (n, 3) meet the surface: locations (h, 3) float64, index_ray and index_tri (h,) int64."""
        index_tri, index_ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, return_locations=True
        )
        return locations, index_ray, index_tri

    def intersects_id(
        self,
        ray_origins: ArrayLike,
        ray_directions: ArrayLike,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
    ) -> tuple[Any, ...]:
        """Which triangles rays meet.

        Args:
            ray_origins, ray_directions: (n, 3) float; directions of any length.
            multiple_hits: all hits of a ray, not just the nearest.
            max_hits: only so many of the nearest of each ray.
            return_locations: whether to return the points too.

        Returns:
            index_tri, index_ray: (h,) int64: first the nearest hit of each ray, by ray, then the second ones, …
            locations: (h, 3) float64, on the triangles' planes to the precision of float64; if return_locations.

        Raises:
            ValueError: origins and directions are not alike (n, 3).
        """
        origins, directions = _rays(ray_origins, ray_directions)
        tracer = self.tracer
        if multiple_hits:
            hits = tracer.all_hits(origins, directions, max_hits=max_hits)
            index_tri, index_ray = hits.triangle, hits.ray
        else:
            nearest = tracer.closest(origins, directions).triangle
            index_ray = np.flatnonzero(nearest >= 0)
            index_tri = nearest[index_ray].astype(np.int64)
        if return_locations:
            return index_tri, index_ray, tracer.locate(origins, directions, index_ray, index_tri)
        return index_tri, index_ray

    def intersects_first(self, ray_origins: ArrayLike, ray_directions: ArrayLike) -> NDArray[np.int32]:
        """(n,) int32: the first triangle that each of the rays (n, 3) meets, or −1."""
        return self.tracer.closest(*_rays(ray_origins, ray_directions)).triangle

    def intersects_any(self, ray_origins: ArrayLike, ray_directions: ArrayLike) -> NDArray[np.bool_]:
        """(n,) bool: whether each of the rays (n, 3) meets the surface."""
        return self.tracer.occluded(*_rays(ray_origins, ray_directions))

    def contains_points(self, points: ArrayLike) -> NDArray[np.bool_]:
        """(n,) bool: whether points (n, 3) are inside of the mesh, by the parity of hits; on the surface, either."""
        from trimesh.ray.ray_util import contains_points

        return np.asarray(contains_points(self, points))

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_built": None}

    def __copy__(self) -> RayMeshIntersector:
        return RayMeshIntersector(self.mesh, device=self._device)

    def __deepcopy__(self, memo: dict[int, Any]) -> RayMeshIntersector:
        return self.__copy__()


def _rays(ray_origins: ArrayLike, ray_directions: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    origins, directions = np.asarray(ray_origins), np.asarray(ray_directions)
    if origins.shape != directions.shape or origins.ndim != 2 or origins.shape[1] != 3:
        shapes = f"{origins.shape} and {directions.shape}"
        raise ValueError(f"rays: expected origins and directions of shape (n, 3), got {shapes}")
    return origins, directions
