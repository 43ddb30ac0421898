"""What each protection of the kernels costs: pictures with it and without it, interleaved."""

from __future__ import annotations

import statistics

from bench.report import Outcome, Table
from pyrt.renderer import Renderer
from pyrt.scene_io import load_scene
from tests.controls import kernels

PROTECTIONS = {
    "edge functions exact to the sign": ("rounded edges",),
    "watertight triangle test": ("Möller–Trumbore", "Möller–Trumbore in packets"),
    "box padding": ("no box padding",),
    "skip of the own primitive": ("no id skip",),
    "offset of spawned rays": ("no offset",),
    "margin at edges": ("no edge margin",),
}
SCENES = ("cornell_area_light", "mesh_room")


def run(quick: bool, repeats: int) -> Outcome:
    """Kernel seconds with everything on, over those with one protection off; beams are off, to trace all rays."""
    rows, figures = [], {}
    for name in SCENES:
        scene = load_scene(f"example:{name}")
        shipped, weakened = Renderer(scene, beams=False), {}
        for protection, controls in PROTECTIONS.items():
            with kernels(*controls):
                weakened[protection] = Renderer(scene, beams=False)
        for protection, ratio in _ratios(shipped, weakened, 4 if quick else 16, repeats).items():
            rows.append((name, protection, f"{ratio:.3f}"))
            figures[f"{name}: {protection}"] = ratio
    note = "Seconds with everything on, over seconds without the protection; medians of pairs. 1: it costs nothing."
    return Outcome((Table("Cost of protections", ("scene", "protection", "cost"), tuple(rows), (note,)),), figures, {})


def _ratios(shipped: Renderer, weakened: dict[str, Renderer], spp: int, repeats: int) -> dict[str, float]:
    pairs: dict[str, list[float]] = {name: [] for name in weakened}
    for renderer in (shipped, *weakened.values()):
        renderer.render(1)
    for _ in range(repeats):
        base = shipped.render(spp).stats["seconds"]["render"]
        for name, renderer in weakened.items():
            pairs[name].append(base / renderer.render(spp).stats["seconds"]["render"])
    return {name: statistics.median(values) for name, values in pairs.items()}
