"""What one loading of a scene collects on its way: files, problems, warnings, and how much room there still is."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from pyrt.errors import PyrtError, SceneError
from pyrt.model import Model
from pyrt.room import available
from pyrt.schema_errors import quote, suggestion

T = TypeVar("T")

_TRIANGLE = 100  # bytes of one in a scene; building its tree takes more, see `memory`


@contextmanager
def uncollected() -> Iterator[None]:
    """Without Python's collector of cycles, which would look through a million new objects again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@dataclass
class Loading:
    """What one call of load_scene collects."""

    place: str
    folder: Path
    model: Model | None = None  # whose meshes and images stand for files
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[tuple[Any, ...], Any] = field(default_factory=dict)  # read files, or None for unreadable ones
    room: float = field(default_factory=lambda: available() / _TRIANGLE)  # for so many triangles

    def take(self, path: str, triangles: int) -> None:
        """Raises PyrtError unless there is memory for the object at `path`, too."""
        if triangles > self.room:
            found = f"{triangles:,} triangles, memory has room for {int(self.room):,} more"
            raise PyrtError(f"{self.place}: {path}: {found}")
        self.room -= triangles

    def has_image(self, path: str) -> bool:
        """Whether the path is no file's, but names an image of the model."""
        return self.model is not None and path in self.model.images

    def problem(self, path: str, text: str) -> None:
        self.problems.append(f"{self.place}: {path}: {text}")

    def warn(self, path: str, text: str) -> None:
        self.warnings.append(f"{self.place}: {path}: {text}")

    def check_name(self, path: str, kind: str, name: str | None, entries: Any) -> None:
        """Looks it up in the file's entries, valid or not, so that a broken one is not reported as missing too."""
        if name is not None and isinstance(entries, dict) and name not in entries:
            self.problem(path, f"no {kind} {quote(name)}{suggestion(name, entries)}")

    def read(self, path: str, reader: Callable[..., T], name: str, *options: Any) -> T | None:
        """reader(file, *options), once per file; None, and a problem at `path`, if it fails."""
        file = os.path.normpath(self.folder / name)
        key = (reader, file, *options)
        if key not in self.files:
            try:
                self.files[key] = reader(file, *options)
            except SceneError as error:
                self.files[key] = None
                for problem in error.problems:
                    self.problem(path, problem)
            else:
                for warning in getattr(self.files[key], "warnings", ()):
                    self.warn(path, warning)
        result: T | None = self.files[key]
        return result
