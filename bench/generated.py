"""Scenes that nobody chose: generators whose seeds from `UNSEEN` on nothing in pyrt was chosen by.

With smaller seeds anybody may look at what helps; what is claimed has to hold for the others. The benchmark draws new
ones in each run and tells which.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pyrt import load_scene
from pyrt.scene import Scene

FOLDER = Path(__file__).parent.parent / "scenes"
UNSEEN = 1000

Item = dict[str, Any]


def unseen() -> tuple[str, ...]:
    """A scene of each generator that nobody has seen, for `generated`."""
    return tuple(f"{name} {UNSEEN + secrets.randbelow(10**6)}" for name in GENERATORS)


def generated(name: str) -> Scene:
    """The scene of a generator and a seed, as "garden 1234".

    Raises:
        ValueError: there is no such generator, or no seed.
    """
    kind, _, seed = name.partition(" ")
    if kind not in GENERATORS or not seed.isdecimal():
        raise ValueError(f'expected the name of a scene, or {" or ".join(GENERATORS)} with a seed, got "{name}"')
    return GENERATORS[kind](int(seed))


def clutter(seed: int) -> Scene:
    """The Cornell room with boards and balls in it, and lamps of three kinds."""
    random = np.random.default_rng(seed)
    raw = json.loads((FOLDER / "cornell.json").read_text(encoding="utf-8"))
    raw["integrator"] = {"type": "direct", "spp": 32}
    colors = ["red_diffuse", "green_diffuse", "grey_diffuse"]
    for _ in range(24):
        center = random.uniform((-0.9, 0.1, -0.9), (0.9, 1.5, 0.7)).tolist()
        edges = random.normal(size=(2, 3)) * 0.2
        board = _rectangle(center, *edges)
        ball = {"type": "icosphere", "center": center, "radius": float(random.uniform(0.03, 0.2)), "subdivisions": 3}
        chosen = board if random.random() < 0.5 else ball
        raw["objects"].append({**chosen, "material_name": colors[random.integers(3)]})
    raw["objects"] += [
        {**_rectangle(center, (side, 0, 0), (0, 0, side)), "light": {"radiance": radiance}}
        for center, side, radiance in (([-0.5, 1.95, 0.2], 0.5, [20, 16, 12]), ([0.6, 1.9, -0.4], 0.2, [20, 30, 60]))
    ]
    raw["lights"] = [{"type": "point", "position": [0.1, 1.7, 0.9], "flux": [9, 9, 9]}]
    return load_scene(raw, base_dir=FOLDER)


def garden(seed: int) -> Scene:
    """A paved garden by night: textures, thin fences, glass, rough stones, point lights and a round lamp."""
    random = np.random.default_rng(seed)
    stones = [str(random.choice(("marble", "wood", "zellige"))) for _ in range(2)]
    repeated = {"scale": [float(random.integers(2, 12))] * 2}
    raw: Item = {
        "integrator": {"type": "direct"},
        "camera": {
            "position": random.uniform((-2, 0.6, 3.5), (2, 2.5, 5)).tolist(),
            "look_at": [0, 0.5, 0],
            "fov": float(random.uniform(30, 60)),
        },
        "textures": {
            "ground": {"type": "checkerboard", "color0": [0.7, 0.6, 0.5], "tex_coordinate_generator": repeated},
            "wall": {"type": "image", "path": f"../textures/{stones[0]}.png"},
            "stone": {"type": "image", "path": f"../textures/{stones[1]}.png", "tex_coordinate_generator": repeated},
        },
        "materials": {
            **{name: {"type": "diffuse", "texture_name": name} for name in ("ground", "wall", "stone")},
            "wood": {"type": "diffuse", "color": random.uniform(0.2, 0.8, 3).tolist()},
            "glass": {"type": "dielectric"},
        },
        "objects": [
            {**_rectangle((0, 0, 0), (12, 0, 0), (0, 0, -12)), "material_name": "ground"},
            {**_rectangle((0, 1.5, -3), (9, 0, 0), (0, 3, 0)), "material_name": "wall"},
            *_fence(random),
            *_fence(random),
            *(_stone(random) for _ in range(random.integers(3, 9))),
            {
                "type": "sphere",
                "center": random.uniform((-2, 1.2, -1.5), (2, 2.5, 1)).tolist(),
                "radius": float(random.uniform(0.02, 0.3)),
                "light": {"radiance": (10 * random.uniform(0.5, 2, 3)).tolist()},
            },
        ],
        "lights": [
            {
                "type": "point",
                "position": random.uniform((-3, 0.8, -2), (3, 3, 4)).tolist(),
                "flux": (60 * random.uniform(0.5, 2, 3)).tolist(),
            }
            for _ in range(random.integers(1, 4))
        ],
    }
    return load_scene(raw, base_dir=FOLDER)


def _fence(random: np.random.Generator) -> list[Item]:
    """Slats in a row, some far narrower than a pixel."""
    start, step = random.uniform((-2.5, 0, -1.5), (-1, 0, 1.5)), random.uniform((0.04, 0, -0.04), (0.2, 0, 0.04))
    width, height = random.uniform(0.002, 0.04), random.uniform(0.3, 1)
    middle = start + (0, height / 2, 0)
    return [
        {**_rectangle(middle + k * step, (width, 0, 0), (0, height, 0)), "material_name": "wood"}
        for k in range(random.integers(8, 24))
    ]


def _stone(random: np.random.Generator) -> Item:
    radius = float(random.uniform(0.1, 0.5))
    center = random.uniform((-2, 0.8 * radius, -2), (2, 3 * radius, 1.5)).tolist()
    if random.random() < 0.4:
        return {
            "type": "sphere",
            "center": center,
            "radius": radius,
            "material_name": str(random.choice(("glass", "stone"))),
        }
    rough = {"amplitude": float(random.uniform(0, 0.5)), "seed": int(random.integers(1000))}
    mesh = {"type": "icosphere", "center": center, "radius": radius, "subdivisions": 4, "displacement": rough}
    return {**mesh, "smooth": bool(random.random() < 0.5), "material_name": str(random.choice(("wood", "glass")))}


def _rectangle(center: Any, edge1: Any, edge2: Any) -> Item:
    numbers = {"center": center, "edge1": edge1, "edge2": edge2}
    return {"type": "rectangle", **{name: np.asarray(value, float).tolist() for name, value in numbers.items()}}


GENERATORS: dict[str, Callable[[int], Scene]] = {"clutter": clutter, "garden": garden}
