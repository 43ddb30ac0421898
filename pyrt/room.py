"""How much memory there is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")


def available(proc: Path = Path("/proc"), groups: Path = _GROUPS) -> float:
    """Bytes that this process can still take: what is free, or soon would be, in the machine and in its control groups,
    which limit containers and batch jobs; infinite where the system (not Linux) does not tell."""
    free = next((1024.0 * kib for key, kib in _numbers(proc / "meminfo") if key == "MemAvailable:"), math.inf)
    return min([free, *_group_room(proc / "self" / "cgroup", groups)])


def _group_room(memberships: Path, groups: Path) -> Iterator[float]:
    """What each control group of this process has left: lines `hierarchy:controllers:/path`; version 2 names none."""
    for line in _text(memberships).splitlines():
        _, controllers, path = line.split(":", 2)
        if controllers not in ("", "memory"):
            continue
        top, limit, used, cache = (
            (groups / "memory", "limit_in_bytes", "usage_in_bytes", "total_inactive_file")
            if controllers
            else (groups, "max", "current", "inactive_file")
        )
        inner = top / path.lstrip("/")
        for folder in (inner, *inner.parents):
            end, begin = (_text(folder / f"memory.{name}").strip() for name in (limit, used))
            if end.isdecimal() and begin.isdecimal():
                reclaimable = next((n for key, n in _numbers(folder / "memory.stat") if key == cache), 0)
                yield float(int(end) - int(begin) + reclaimable)
            if folder == top:
                break


def _numbers(file: Path) -> Iterator[tuple[str, int]]:
    """`key number …` of each line."""
    rows = (line.split() for line in _text(file).splitlines())
    return ((row[0], int(row[1])) for row in rows if len(row) > 1 and row[1].isdecimal())


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
