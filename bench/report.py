"""Results for people and for programs: tables, JSON, plots, and the comparison with an earlier run."""

from __future__ import annotations

import json
import math
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

PACKAGES = ("numpy", "pyopencl", "pocl-binary-distribution", "drjit")


@dataclass(frozen=True)
class Table:
    """Rows of cells; the first column is text, the others are aligned to the right. Notes stand below."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What a part of the benchmark found: tables for people, `figures` to compare runs by, `data` for all the rest."""

    tables: tuple[Table, ...]
    figures: dict[str, float]
    data: dict[str, Any]


def provenance(arguments: Sequence[str], device: str, peers: str) -> dict[str, Any]:
    """Date, machine, command and versions: what a figure is worth nothing without."""
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "machine": f"{_processor()}, {_cores()} cores, {platform.system()} {platform.machine()}",
        "command": shlex.join(["python", "-m", "bench", *arguments]),
        "device": device,
        "peers": peers,
        "versions": {"python": platform.python_version(), **_versions()},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def _cores() -> int:
    import os

    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _versions() -> dict[str, str]:
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def heading(about: Mapping[str, Any]) -> str:
    """Two lines that stand above every table."""
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    return f"{about['date']}; {about['machine']}; `{about['command']}`\n{about['device']}; {about['peers']}; {versions}"


def markdown(table: Table, about: Mapping[str, Any]) -> str:
    """The table as aligned Markdown, which a terminal shows as well."""
    cells = [table.columns, *table.rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(table.columns))]

    def line(row: Sequence[str]) -> str:
        first, *rest = zip(row, widths, strict=True)
        return f"| {' | '.join([first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in rest)])} |"

    rule = "|" + "|".join("-" * (w + 2) if i == 0 else "-" * (w + 1) + ":" for i, w in enumerate(widths)) + "|"
    notes = [f"* {note}" for note in table.notes]
    body = [line(table.columns), rule, *(line(row) for row in table.rows)]
    return "\n".join([f"### {table.title}", "", heading(about), "", *body, *([""] if notes else []), *notes, ""])


def number(value: float | None, digits: int = 3) -> str:
    """A figure with so many significant digits; a dash for what was not measured."""
    if value is None or math.isnan(value):
        return "–"
    if value != 0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:,.0f}"


def write_json(path: Path, about: Mapping[str, Any], outcomes: Mapping[str, Outcome]) -> None:
    parts = {name: {"figures": outcome.figures, "data": outcome.data} for name, outcome in outcomes.items()}
    path.write_text(json.dumps({"about": about, "parts": parts}, indent=1) + "\n", encoding="utf-8")


def comparison(old: Mapping[str, Any], outcomes: Mapping[str, Outcome]) -> Table:
    """Figures of an earlier run's JSON beside those of this one."""
    rows = []
    for part, outcome in outcomes.items():
        before = old["parts"].get(part, {}).get("figures", {})
        for name in [*outcome.figures, *(set(before) - set(outcome.figures))]:
            a, b = before.get(name), outcome.figures.get(name)
            ratio = b / a if a and b is not None else None
            rows.append((f"{part}: {name}", number(a), number(b), number(ratio)))
    title = f"Against the run of {old['about']['date']}"
    return Table(title, ("figure", "old", "new", "new / old"), tuple(rows))


def curves(
    path: Path,
    title: str,
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    labels: tuple[str, str] = ("seconds", "relMSE"),
) -> None:
    """Plots x against y, log–log; pyrt stands out. Needs matplotlib; without it, nothing is written."""
    try:
        from matplotlib.figure import Figure
        from matplotlib.ticker import LogLocator, NullFormatter
    except ImportError:
        print(f"{path.name}: not drawn, for matplotlib is missing", file=sys.stderr)
        return
    figure = Figure(figsize=(7, 5), layout="constrained")
    axes = figure.add_subplot(xscale="log", yscale="log", xlabel=labels[0], ylabel=labels[1], title=title)
    for name, (x, y) in lines.items():
        axes.plot(x, y, marker="o", label=name, linewidth=2.5 if name.startswith("pyrt") else 1)
    if axes.get_xlim()[1] < 1e3 * axes.get_xlim()[0]:  # labels at every digit would overlap
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path)


def error_maps(path: Path, title: str, maps: Mapping[str, NDArray[np.float64]]) -> None:
    """Squared errors (height, width) side by side on one logarithmic scale. Needs matplotlib."""
    try:
        from matplotlib.colors import LogNorm
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(4 * len(maps), 4.4), layout="constrained")
    axes = figure.subplots(1, len(maps), squeeze=False)[0]
    high = max(float(values.max()) for values in maps.values())
    for axis, (name, values) in zip(axes, maps.items(), strict=True):
        shown = axis.imshow(np.maximum(values, high * 1e-8), norm=LogNorm(high * 1e-6, high))
        axis.set(title=name, xticks=[], yticks=[])
    figure.colorbar(shown, ax=axes, label="squared relative error")
    figure.suptitle(title)
    figure.savefig(path)
