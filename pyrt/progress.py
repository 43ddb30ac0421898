"""Showing progress of long work on stderr: a bar on a terminal, one JSON event a line, or nothing.

Events are dicts with the keys

    stage     "load", "build", "compile", "render", "save" or "done", in this order
    done      0 … 1, of the stage
    seconds   since the command began

and of the stage "render", once after every pass, also

    samples           traced so far
    rays              traced so far
    rays_per_second   or null
    noise             estimated relative error of the picture so far; null if not known
    eta               seconds that the stage will take from now on; null if not known
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from io import StringIO
from time import perf_counter
from typing import Any

from pyrt.watch import Progress


@contextmanager
def show_progress(mode: str, *, stages: bool = False) -> Iterator[Progress]:
    """Yields the callable that work reports to, with events that need no times yet.

    Args:
        mode: "bar", "json", "none", or "auto": a bar if stderr is a terminal, else nothing.
        stages: also print each stage and what it took, when it is over.
    """
    if mode == "auto":
        mode = "bar" if sys.stderr and sys.stderr.isatty() else "none"
    start = perf_counter()
    begun: dict[str, float] = {}  # stages, on the clock of `start`
    with _bar() if mode == "bar" else nullcontext(_print_json if mode == "json" else _ignore) as show:

        def report(event: dict[str, Any]) -> None:
            now = perf_counter() - start
            stage = event["stage"]
            if stages and begun and stage not in begun:
                last = next(reversed(begun))
                _print(f"{last:<8} {now - begun[last]:8.3f} s")
            elapsed = now - begun.setdefault(stage, now)
            event = {**event, "seconds": now}
            if stage == "render":
                done = event["done"]
                event["rays_per_second"] = event["rays"] / elapsed if elapsed > 0 else None
                event["eta"] = elapsed * (1 - done) / done if done > 0 and elapsed > 0 else None
            show(event)

        report({"stage": "load", "done": 0.0})
        yield report
        report({"stage": "done", "done": 1.0})


def _ignore(event: dict[str, Any]) -> None:
    pass


def _print_json(event: dict[str, Any]) -> None:
    _print(json.dumps(event))


def _print(line: str) -> None:
    with suppress(OSError):  # that nobody reads along is no reason to stop
        print(line, file=sys.stderr or StringIO(), flush=True)


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description:>7}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("load", total=1.0, text="")

        def show(event: dict[str, Any]) -> None:
            bar.update(task, description=event["stage"], completed=event["done"], text=_bar_text(event))

        yield show


def _bar_text(event: dict[str, Any]) -> str:
    """What stands beside the bar: share done, samples, speed, error, and the time that is left."""
    if event["stage"] != "render":
        return ""
    parts = [f"{100 * event['done']:3.0f} %", f"{event['samples'] / 1e6:.1f} M samples"]
    if event["rays_per_second"]:
        parts.append(f"{event['rays_per_second'] / 1e6:.1f} Mrays/s")
    if event["noise"]:
        parts.append(f"error {event['noise']:.2g}")
    if event["eta"]:
        parts.append(f"{event['eta']:.0f} s left")
    return "  ".join(parts)
