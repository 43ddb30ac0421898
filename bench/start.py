"""Whole processes: from pressing Enter to the picture on disk, with empty and with filled caches, and their memory."""

from __future__ import annotations

import compileall
import json
import statistics
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench import peers_mitsuba
from bench.measure import paired_ratio
from bench.process import Process, run_python
from bench.report import Outcome, Table, number
from bench.scenes import FOLDER, MILLION, bumpy_ball, shipped
from pyrt import load_scene
from pyrt.scene import Mesh

ROOT = FOLDER.parent
MITSUBA_SCRIPT = """
import sys
import mitsuba as mi

mi.set_variant(sys.argv[1])
image = mi.render(mi.load_file(sys.argv[2]), spp=int(sys.argv[3]))
mi.util.write_bitmap(sys.argv[4] + ".exr", image)
mi.util.write_bitmap(sys.argv[4] + ".png", image)
"""


@dataclass(frozen=True)
class Work:
    """A picture to make: the scene file, which may be made in a folder first, its size and samples."""

    label: str
    scene_file: Callable[[Path], Path]
    side: int
    spp: int


def _smooth_ball(folder: Path) -> Path:
    """The mesh room of 1.3 million triangles."""
    mesh = shipped("mesh_room", **MILLION).shapes[5]
    assert isinstance(mesh, Mesh)
    assert mesh.normals is not None
    normals = np.zeros_like(mesh.vertices)
    normals[mesh.triangles] = mesh.normals
    return _room_with(mesh.vertices, mesh.triangles, normals, folder)


def _flat_ball(folder: Path) -> Path:
    vertices, triangles = bumpy_ball(1_000_000)
    return _room_with(0.66 * vertices + (0, 0.772, -0.1), triangles, None, folder)


def _room_with(vertices: Any, triangles: Any, normals: Any, folder: Path) -> Path:
    """The mesh room with a mesh from a PLY file, so that nobody has to compute it."""
    import trimesh

    ball = trimesh.Trimesh(vertices, triangles, vertex_normals=normals, process=False)
    ball.export(folder / "ball.ply", vertex_normal=normals is not None)
    raw = json.loads((FOLDER / "mesh_room.json").read_text(encoding="utf-8"))
    for item in raw["objects"]:
        if "path" in item:
            item["path"] = str(FOLDER / item["path"])
    raw["objects"][5] = {"type": "mesh", "path": "ball.ply", "material_name": "grey_diffuse"}
    (folder / "room.json").write_text(json.dumps(raw), encoding="utf-8")
    return folder / "room.json"


CORNELL = Work("cornell.json, 512×512, 32 spp", lambda folder: FOLDER / "cornell.json", 512, 32)
LARGE = (
    Work("room with 1,000,000 flat triangles, 1024×1024, 1 spp", _flat_ball, 1024, 1),
    Work("room with 1,310,720 smooth triangles, 1024×1024, 1 spp", _smooth_ball, 1024, 1),
)


def run(quick: bool, repeats: int) -> Outcome:
    """Wall seconds and peak memory of `python -m pyrt render` and of a Mitsuba script that makes the same picture."""
    rows, figures, data = [], {}, {}
    for work in (CORNELL,) if quick else (CORNELL, *LARGE):
        times = 1 if quick else repeats if work is CORNELL else 2
        for state, of in _measure(work, times).items():
            data[f"{work.label}, {state}"] = of
            ours, theirs = of["pyrt"], of.get("Mitsuba")
            key = f"{work.label}, {state}"
            figures[f"{key}, pyrt s"] = ours["median"]
            figures[f"{key}, pyrt MiB"] = ours["MiB"]
            ratio = share = None
            if theirs:
                ratio = figures[f"{key}, pyrt / Mitsuba"] = 1 / paired_ratio(ours["seconds"], theirs["seconds"])
                share = figures[f"{key}, pyrt / Mitsuba MiB"] = ours["MiB"] / theirs["MiB"]
            rows.append(
                (
                    key,
                    number(ours["median"]),
                    number(theirs and theirs["median"]),
                    number(ratio),
                    number(ours["MiB"]),
                    number(theirs and theirs["MiB"]),
                    number(share),
                )
            )
    columns = ("whole process", "pyrt s", "Mitsuba s", "pyrt / Mitsuba", "pyrt MiB", "Mitsuba MiB", "pyrt / Mitsuba")
    notes = (
        "Wall time from an interpreter that is not running yet to EXR and PNG on disk; cold: with empty caches of "
        "compiled kernels, warm: with full ones. Peak resident memory.",
    )
    return Outcome((Table("Start to finish", columns, tuple(rows), notes),), figures, data)


def _measure(work: Work, repeats: int) -> dict[str, dict[str, Any]]:
    """By cache state and renderer: seconds, their median, and peak MiB. A cold and a warm run share a cache."""
    found: dict[str, dict[str, Any]] = {}
    compileall.compile_dir(ROOT / "pyrt", quiet=1)  # as pip does on installing; Python need not keep bytecode itself
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        commands = _commands(work, Path(folder))
        for repetition in range(repeats):
            for name, command in commands.items():
                cache = Path(folder) / f"cache-{name}-{repetition}"
                cache.mkdir()
                for state in ("cold", "warm"):
                    print(f"start: {work.label}, {name}, {state}", file=sys.stderr)
                    process = _run(command, Path(folder), cache)
                    entry = found.setdefault(state, {}).setdefault(name, {"seconds": [], "MiB": 0.0})
                    entry["seconds"].append(process.seconds)
                    entry["MiB"] = max(entry["MiB"], process.peak)
    for renderers in found.values():
        for entry in renderers.values():
            entry["median"] = statistics.median(entry["seconds"])
    return found


def _commands(work: Work, folder: Path) -> dict[str, list[str]]:
    scene_file, spp = work.scene_file(folder), str(work.spp)
    options = ["-q", f"--size={work.side}x{work.side}", f"--spp={spp}"]
    outputs = ["-o", str(folder / "ours.exr"), "-o", str(folder / "ours.png")]
    commands = {"pyrt": ["-m", "pyrt", "render", str(scene_file), *options, *outputs]}
    if peers_mitsuba.version():
        xml = peers_mitsuba.write_scene(load_scene(scene_file), (work.side, work.side), folder)
        arguments = [peers_mitsuba.variant(), str(xml), spp, str(folder / "theirs")]
        commands["Mitsuba"] = ["-c", MITSUBA_SCRIPT, *arguments]
    return commands


def _run(arguments: list[str], folder: Path, cache: Path) -> Process:
    """A process whose caches are in `cache`: PoCL's, pyrt's, and (below HOME) Dr.Jit's."""
    caches = {name: str(cache) for name in ("POCL_CACHE_DIR", "XDG_CACHE_HOME", "HOME")}
    return run_python(arguments, folder, {**caches, "PYTHONPATH": str(ROOT)})
