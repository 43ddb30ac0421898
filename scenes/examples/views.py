"""A data set of views: python views.py [MODEL] [--views 12] [--size 256] [--spp 32] [--folder views]

For each view a picture, its depth and mask as arrays (.npy, in the picture's shape), and everything together in one EXR
file. cameras.json holds the calibration K, in pixels, and for each view the pose as OpenCV's camera-to-world matrix.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import trimesh

import pyrt

LIGHTS = [{"position": [4, 6, 5], "flux": [900, 900, 900]}, {"position": [-6, 3, -4], "flux": [500, 500, 600]}]


def pose(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """The (4, 4) camera-to-world matrix, +x right, +y down, +z ahead, of a camera that looks at the origin."""
    ahead = -np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3] = np.stack([right, np.cross(ahead, right), ahead, -distance * ahead], axis=1)
    return matrix


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("model", nargs="?", help="a model file (default: a short pipe)")
    options.add_argument("--views", type=int, default=12)
    options.add_argument("--size", type=int, default=256)
    options.add_argument("--spp", type=int, default=32)
    options.add_argument("--folder", type=Path, default=Path("views"))
    args = options.parse_args()

    mesh = trimesh.load(args.model, force="mesh") if args.model else trimesh.creation.annulus(0.4, 1.0, 0.6)
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1 / np.linalg.norm(mesh.vertices, axis=1).max())  # into the unit sphere
    focal = 1.2 * args.size
    K = [[focal, 0, args.size / 2], [0, focal, args.size / 2], [0, 0, 1]]  # noqa: N806
    poses = [pose(2 * np.pi * i / args.views, np.radians(25), 3.2) for i in range(args.views)]

    args.folder.mkdir(exist_ok=True)
    for i, matrix in enumerate(poses):
        camera = {"matrix": matrix.tolist(), "convention": "opencv", "intrinsics": {"K": K}}
        film = {"resolution": [args.size, args.size]}
        scene = pyrt.from_trimesh(mesh, overrides={"camera": camera, "film": film, "lights": LIGHTS})
        result = pyrt.render(scene, spp=args.spp, aovs=["z", "object", "normal"])
        name = args.folder / f"{i:03d}"
        result.save(f"{name}.png")
        result.save(f"{name}.exr")
        np.save(f"{name}_depth.npy", result.aovs["z"])
        np.save(f"{name}_mask.npy", result.aovs["object"] == 0)
    text = json.dumps({"K": K, "camera_to_world": [matrix.tolist() for matrix in poses]}, indent=1)
    (args.folder / "cameras.json").write_text(text)


if __name__ == "__main__":
    main()
