"""Showing progress of long work on stderr: a bar on a terminal, one JSON event a line, or nothing."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from time import perf_counter
from typing import Any

from pyrt.renderer import Progress


@contextmanager
def show_progress(mode: str) -> Iterator[Progress]:
    """Yields the callable that work reports to, with dicts of `stage` and `done` (0 … 1).

    Args:
        mode: "bar", "json", "none", or "auto": a bar if stderr is a terminal, else nothing.
    """
    if mode == "auto":
        mode = "bar" if sys.stderr and sys.stderr.isatty() else "none"
    if mode == "bar":
        with _bar() as report:
            yield report
    else:
        yield _print_json if mode == "json" else _ignore


def _ignore(event: dict[str, Any]) -> None:
    pass


def _print_json(event: dict[str, Any]) -> None:
    with suppress(OSError):  # that nobody reads along is no reason to stop
        print(json.dumps(event), file=sys.stderr or StringIO(), flush=True)


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description:>8}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %  {task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("load", total=1.0, rate="")
        started: dict[str, float] = {}

        def report(event: dict[str, Any]) -> None:
            start = started.setdefault(event["stage"], perf_counter())
            rays = event.get("rays", 0)
            elapsed = perf_counter() - start
            rate = f"{rays / elapsed / 1e6:.1f} Mrays/s" if rays and elapsed > 0 else ""
            bar.update(task, description=event["stage"], completed=event["done"], rate=rate)

        yield report
