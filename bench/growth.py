"""How time and memory grow with triangles, pixels, samples and lights: exponents on log-log scales, to find cliffs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from time import process_time

from bench import report
from bench.process import run_python
from bench.report import Outcome, Table, number
from bench.scenes import FOLDER, shipped
from pyrt import Renderer, load_scene
from pyrt.scene import Scene

SLACK = 1.15  # a step may cost this much more than its exponent explains, as times are not exact
QUANTITIES = {"load": "load s", "build": "build s", "render": "render s", "peak": "peak MiB"}


@dataclass(frozen=True)
class Work:
    """What a process does: it loads the scene and renders N×N pixels."""

    scene: Callable[[], Scene]
    side: int
    spp: int


@dataclass(frozen=True)
class Series:
    """Growth with one quantity, which has the values `quick` in the quick mode.

    `limits` are the greatest exponents that time and memory may grow with; where none is given, nothing grows.
    """

    values: tuple[int, ...]
    quick: tuple[int, ...]
    work: Callable[[int], Work]
    limits: Mapping[str, float]


def _room(subdivisions: int) -> Scene:
    return shipped("mesh_room", **{"objects.5.subdivisions": subdivisions})


def _lit(count: int, lamps: bool) -> Scene:
    """The Cornell room with so many lights of equal power, in a square below the ceiling."""
    raw = json.loads((FOLDER / "cornell_area_light.json").read_text(encoding="utf-8"))
    raw["objects"] = [item for item in raw["objects"] if "light" not in item and item["material_name"] != "glass"]
    raw["integrator"] = {"type": "direct"}
    side = math.ceil(count**0.5)
    places = [[1.6 * ((k + 0.5) / side - 0.5) for k in divmod(index, side)] for index in range(count)]
    edge = 0.4 / side
    if lamps:
        raw["objects"] += [
            {
                "type": "rectangle",
                "center": [x, 1.99, z],
                "edge1": [edge, 0, 0],
                "edge2": [0, 0, edge],
                "light": {"radiance": [50, 50, 50]},
            }
            for x, z in places
        ]
    else:
        raw["lights"] = [{"type": "point", "position": [x, 1.9, z], "flux": [30 / count] * 3} for x, z in places]
    return load_scene(raw, base_dir=FOLDER)


_LIGHTS = (1, 2, 4, 8, 9, 16, 32, 64, 128, 256, 512)
SERIES = {
    "triangles": Series(
        tuple(20 * 4**k for k in range(1, 10)),
        (80, 1280, 20480),
        lambda triangles: Work(lambda: _room(round(math.log(triangles / 20, 4))), 256, 4),
        {"load": 1.1, "build": 1.1, "render": 0.3, "peak": 1},
    ),
    "pixels": Series(
        tuple(4**k for k in range(6, 13)),
        (4096, 65536),
        lambda pixels: Work(lambda: shipped("cornell_area_light"), math.isqrt(pixels), 4),
        {"render": 1, "peak": 1},
    ),
    "samples per pixel": Series(
        tuple(4**k for k in range(8)),
        (1, 16, 256),
        lambda spp: Work(lambda: shipped("cornell_area_light"), 128, spp),
        {"render": 1, "peak": 0.2},
    ),
    "point lights": Series(
        _LIGHTS,
        (1, 8, 32),
        lambda lights: Work(lambda: _lit(lights, False), 128, 4),
        {"load": 1, "build": 1, "render": 1},
    ),
    "lamps": Series(
        _LIGHTS,
        (1, 8, 32),
        lambda lights: Work(lambda: _lit(lights, True), 128, 4),
        {"load": 1, "build": 1, "render": 1},
    ),
}


def run(quick: bool, repeats: int, out: Path) -> Outcome:
    """Processor seconds and peak memory of processes that differ in one quantity."""
    tables, figures, data = [], {}, {}
    for name, series in SERIES.items():
        values = series.quick if quick else series.values
        found = _measure(name, values, repeats, 1 if quick else 2)
        data[name] = {"values": values, **found}
        for quantity, column in QUANTITIES.items():
            figures |= {f"{value:,} {name}, {column}": y for value, y in zip(values, found[quantity], strict=True)}
        tables.append(table(name, values, found, series.limits))
        lines = {column: (values, found[quantity]) for quantity, column in QUANTITIES.items()}
        report.curves(out / f"growth_{name.replace(' ', '_')}.png", name, lines, (name, "seconds, MiB"))
    return Outcome(tuple(tables), figures, data)


def _measure(name: str, values: Sequence[int], repeats: int, processes: int) -> dict[str, list[float]]:
    """By quantity: the least of `repeats` renders in a process, and of the processes."""
    found: dict[str, list[float]] = {quantity: [] for quantity in QUANTITIES}
    _figures(name, values[0], 1)  # fills the cache of compiled kernels
    for value in values:
        print(f"growth: {value:,} {name}", file=sys.stderr)
        runs = [_figures(name, value, repeats) for _ in range(processes)]
        for quantity, points in found.items():
            points.append(min(run[quantity] for run in runs))
    return found


def _figures(name: str, value: int, repeats: int) -> dict[str, float]:
    code = f"from bench import growth; growth.child({name!r}, {value}, {repeats})"
    process = run_python(["-c", code], folder=FOLDER.parent)
    return {**json.loads(process.output), "peak": process.peak}


def child(name: str, value: int, repeats: int) -> None:
    """Prints the processor seconds of one point of a series, in a process of its own."""
    work = SERIES[name].work(value)
    start = process_time()
    scene = work.scene()
    loaded = process_time()
    renderer = Renderer(scene)
    built = process_time()
    seconds = []
    for seed in range(repeats + 1):
        start_render = process_time()
        renderer.render(work.spp, seed, (work.side, work.side))
        seconds.append(process_time() - start_render)
    print(json.dumps({"load": loaded - start, "build": built - loaded, "render": min(seconds[1:])}))


def exponents(x: Sequence[float], y: Sequence[float]) -> list[float]:
    """Of growth in each step: y ~ x^exponent."""
    return [math.log(y1 / y0) / math.log(x1 / x0) for (x0, x1), (y0, y1) in zip(pairwise(x), pairwise(y), strict=True)]


def cliffs(x: Sequence[float], y: Sequence[float], limit: float) -> list[bool]:
    """Of each step: whether y grows faster than x^limit, by more than `SLACK`."""
    steps = zip(pairwise(x), pairwise(y), strict=True)
    return [y1 / y0 > SLACK * (x1 / x0) ** limit for (x0, x1), (y0, y1) in steps]


def table(name: str, values: Sequence[int], found: dict[str, list[float]], limits: Mapping[str, float]) -> Table:
    columns: list[list[str]] = [[f"{value:,}" for value in values]]
    for quantity in QUANTITIES:
        y, limit = found[quantity], limits.get(quantity, 0)
        marks = ["" if not cliff else " *" for cliff in cliffs(values, y, limit)]
        steps = [f"{exponent:.2f}{mark}" for exponent, mark in zip(exponents(values, y), marks, strict=True)]
        columns += [[number(value) for value in y], ["", *steps]]
    header = [name, *(title for column in QUANTITIES.values() for title in (column, "exponent"))]
    expected = ", ".join(f"{quantity} {limits.get(quantity, 0)}" for quantity in QUANTITIES)
    notes = (
        "Processor seconds, the least of several; peak memory of the process. Exponents are of the growth since the "
        f"row above; expected: {expected} at most. An asterisk: more than {SLACK:g} times what that explains.",
    )
    return Table(f"Growth with {name}", tuple(header), tuple(zip(*columns, strict=True)), notes)
