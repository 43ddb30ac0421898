"""A picture of what trimesh holds: python mesh_picture.py [--size 640] [--spp 64] [--output mesh.png]"""

from __future__ import annotations

import argparse

import numpy as np
import trimesh

import pyrt


def model() -> trimesh.Scene:
    """A ring with colours that go around, and a ball in it. What trimesh.load reads will do as well."""
    ring = trimesh.creation.torus(1.0, 0.35, 96, 48)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.radians(-70), [1, 0, 0]))
    hue = np.arctan2(ring.vertices[:, 1], ring.vertices[:, 0])[:, None] + np.radians([0, 120, 240])
    ring.visual.vertex_colors = np.uint8(140 + 90 * np.cos(hue))
    ball = trimesh.creation.icosphere(4, 0.45)
    ball.visual.face_colors = [235, 230, 220, 255]
    return trimesh.Scene({"ring": ring, "ball": ball})


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--size", type=int, default=640)
    options.add_argument("--spp", type=int, default=64)
    options.add_argument("--output", default="mesh.png")
    args = options.parse_args()
    scene = pyrt.from_trimesh(model(), overrides={"film.resolution": [args.size, args.size * 3 // 4]})
    pyrt.render(scene, spp=args.spp).save(args.output)


if __name__ == "__main__":
    main()
