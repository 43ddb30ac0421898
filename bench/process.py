"""Processes of their own: what they print, and the time and the memory that they take."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# Linux counts the memory of the process that starts another as that one's own, until it is larger. So a small process
# starts it: an interpreter without `site`.
_STARTER = """
import json, os, sys, time
start = time.perf_counter()
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ)
_, status, usage = os.wait4(child, 0)
figures = time.perf_counter() - start, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024
print("\\n" + json.dumps([*figures, os.waitstatus_to_exitcode(status)]), file=sys.stderr)
"""


@dataclass(frozen=True)
class Process:
    """A process that has ended: wall and processor seconds, MiB of memory at its peak, and its standard output."""

    seconds: float
    processor: float
    peak: float
    output: str


def run_python(
    arguments: Sequence[str], folder: Path | None = None, environment: Mapping[str, str] | None = None
) -> Process:
    """Runs this interpreter with the arguments, in `folder` and with more environment variables.

    Raises:
        RuntimeError: it failed; with the end of what it wrote to standard error.
    """
    command = [sys.executable, "-S", "-c", _STARTER, sys.executable, *arguments]
    given = {**os.environ, **(environment or {})}
    done = subprocess.run(command, cwd=folder, env=given, capture_output=True, text=True, check=True)
    *messages, figures = done.stderr.rstrip().splitlines()
    seconds, processor, peak, code = json.loads(figures)
    if code:
        raise RuntimeError(f"python {' '.join(arguments)[:80]} … failed: {' '.join(messages)[-300:]}")
    return Process(seconds, processor, peak, done.stdout)
