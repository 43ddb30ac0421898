"""A fingerprint of what a scene looks like, to tell whether two renders may be merged or continued."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from pyrt.scene import Scene

# What a render may choose anew, and what only messages use: no sample depends on these.
_LEFT_OUT = {"film", "spp", "name", "warnings"}


def scene_hash(scene: Scene) -> str:
    """SHA-256, 64 hexadecimal digits, of everything in the scene that a sample depends on.

    Equal for equal content, in any process, on any machine and version of Python. It covers array bytes, so a changed
    mesh or texture file changes it; it leaves out the film's size, the scene's `spp`, names and warnings.
    """
    digest = hashlib.sha256()
    for part in _parts(scene):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> Iterator[bytes | memoryview]:
    """An encoding that no two different values share: each kind begins with a letter, and what varies with a length."""
    if value is None:
        yield b"0"
    elif isinstance(value, bool | int | float | np.number):
        yield b"n" + float(value).hex().encode() + b";"
    elif isinstance(value, str):
        text = value.encode("utf-8", "surrogatepass")
        yield b"s%d:" % len(text) + text
    elif isinstance(value, tuple):
        yield b"t%d:" % len(value)
        for item in value:
            yield from _parts(item)
    elif isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        yield f"a{array.dtype.str}{value.shape}:".encode()
        yield array.reshape(-1).view(np.uint8).data
    elif is_dataclass(value):
        names = [field.name for field in fields(value) if field.name not in _LEFT_OUT]
        yield f"d{type(value).__name__}{len(names)}:".encode()
        for name in names:
            yield from _parts(name)
            yield from _parts(getattr(value, name))
    else:
        raise TypeError(f"a scene holds a {type(value).__name__}")
