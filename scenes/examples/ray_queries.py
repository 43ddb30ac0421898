"""Questions that rays answer about a mesh, without a picture: python ray_queries.py [--rays 1000000]"""

from __future__ import annotations

import argparse

import numpy as np
import trimesh

import pyrt


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--rays", type=int, default=1_000_000)
    count = options.parse_args().rays
    rng = np.random.default_rng(0)
    mesh = trimesh.creation.torus(1.0, 0.35, 96, 48)

    # The closest hit of rays from all around to points near the centre.
    tracer = pyrt.RayTracer(mesh.vertices, mesh.faces)
    origins = 3 * unit(rng.normal(size=(count, 3)))
    directions = rng.normal(scale=0.5, size=(count, 3)) - origins
    hits = tracer.closest(origins, directions)
    hit = hits.triangle >= 0
    points = tracer.locate(origins, directions, np.flatnonzero(hit), hits.triangle[hit])
    distance = np.linalg.norm(points - origins[hit], axis=1).mean()
    print(f"hits: {hit.mean():.1%} of the rays, after {distance:.3f} on average")

    # How much of the sky these points see: a random direction for each, in the hemisphere above the surface. The tracer
    # keeps corners to 24 bits, so a ray from a point beside the surface starts 1e-6 of the mesh's size above it.
    normals = mesh.face_normals[hits.triangle[hit]]
    sky = rng.normal(size=points.shape)
    sky *= np.sign(np.sum(sky * normals, axis=1))[:, None]
    print(f"sky: {1 - tracer.occluded(points + 1e-6 * mesh.scale * normals, sky).mean():.1%} of it is open")

    # How far the rays go through the mesh: what lies between entering and leaving.
    every = tracer.all_hits(origins, unit(directions))
    sign = np.where(np.sum(mesh.face_normals[every.triangle] * directions[every.ray], axis=1) < 0, -1, 1)
    inside = np.bincount(every.ray, sign * every.t, minlength=count)
    print(f"inside: {inside[hit].mean():.3f} of the way, on average of the rays that hit")

    # The same through trimesh's own interface: which of some points are inside.
    mesh.ray = pyrt.RayMeshIntersector(mesh)
    share = mesh.contains(rng.uniform(mesh.bounds[0], mesh.bounds[1], (count, 3))).mean()
    print(f"volume: {share * np.prod(mesh.extents):.3f} by points inside, {mesh.volume:.3f} by trimesh's formula")


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


if __name__ == "__main__":
    main()
