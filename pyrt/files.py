"""Reading a whole file, and replacing one so that nobody ever sees a half-written version."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pyrt.errors import SceneError, UsageError


def check_file(path: str | os.PathLike[str]) -> None:
    """Raises SceneError, one sentence, unless `path` is a regular file that can be opened."""
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise SceneError(f"{path}: expected a file, found a {'folder' if os.path.isdir(path) else 'device'}")
        open(path, "rb").close()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise SceneError(f"{path}: cannot be read: {reason.lower()}") from None


def check_target(path: str | os.PathLike[str]) -> None:
    """Raises UsageError, one sentence, if no file of that name can be written."""
    folder = Path(path).parent
    if os.path.isdir(path):  # unlike Path.is_dir, no error for a name that is too long
        raise UsageError(f"{path}: expected a file name, found a folder")
    if not os.path.isdir(folder):
        raise UsageError(f"{path}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise UsageError(f"{path}: the folder {folder} is not writable")


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a regular file. Raises SceneError as `check_file`."""
    check_file(path)
    return Path(path).read_bytes()


def remove_leftovers(path: str | os.PathLike[str]) -> None:
    """Removes the temporary files of processes that were killed while replacing `path`; none may still be at it."""
    target = Path(os.path.realpath(path))
    name = re.compile(re.escape(f".{target.stem}.") + "[0-9a-f]{8}" + re.escape(target.suffix))
    for file in target.parent.iterdir():
        if name.fullmatch(file.name):
            file.unlink(missing_ok=True)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yields a temporary name beside `path` with its extension; what is written there replaces `path` at the end.

    When the block raises, `path` keeps its old content and the temporary file is removed.
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)
