"""A fingerprint of what a scene looks like, to tell whether two renders may be merged or continued."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from itertools import chain
from typing import Any

import numpy as np

from pyrt.scene import Scene

# What a render may choose anew, and what only messages use: no sample depends on these.
_LEFT_OUT = {"film", "spp", "name", "warnings"}
_NUMBERS = {float, int, bool}

_Kind = tuple[Any, ...]


def scene_hash(scene: Scene) -> str:
    """SHA-256, 64 hexadecimal digits, of everything in the scene that a sample depends on.

    Equal for equal content, in any process, on any machine and version of Python. It covers array bytes, so a changed
    mesh or texture file changes it; it leaves out the film's size, the scene's `spp`, names and warnings.
    """
    digest = hashlib.sha256()
    for part in _parts([scene]):
        digest.update(part)
    return digest.hexdigest()


def _parts(values: list[Any]) -> Iterator[bytes | memoryview]:
    """An encoding that no two different lists of one length share.

    It tells the kind of each value, and then what those of each kind hold, field by field: a million spheres are some
    arrays of numbers.
    """
    groups: dict[_Kind, list[Any]] = {}
    if set(map(type, values)) <= _NUMBERS:
        groups["number",] = values
    else:
        kinds = [_kind(value) for value in values]
        groups = {kind: [] for kind in kinds}
        for kind, value in zip(kinds, values, strict=True):
            groups[kind].append(value)
    yield f"{list(groups)}:".encode()
    if len(groups) > 1:
        number = {kind: i for i, kind in enumerate(groups)}
        yield np.array([number[kind] for kind in kinds], "<u4").data
    for kind, group in groups.items():
        yield from _contents(kind, group)


def _kind(value: Any) -> _Kind:
    """The type, and the size of what has one."""
    name = _type_name(value.__class__)
    if name == "tuple":
        return name, len(value)
    if name == "array":
        return name, value.dtype.newbyteorder("<").str, value.shape
    return (name,)


@cache
def _type_name(kind: type) -> str:
    if issubclass(kind, bool | int | float | np.number):
        return "number"
    known = {type(None): "none", str: "text", tuple: "tuple", np.ndarray: "array"}
    if kind not in known and not is_dataclass(kind):
        raise TypeError(f"a scene holds a {kind.__name__}")
    return known.get(kind, f"data {kind.__name__}")


def _contents(kind: _Kind, values: list[Any]) -> Iterator[bytes | memoryview]:
    """What values of one kind hold."""
    if kind[0] == "number":
        yield np.array(values, "<f8").data
    elif kind[0] == "text":
        for text in (value.encode("utf-8", "surrogatepass") for value in values):
            yield b"%d:" % len(text) + text
    elif kind[0] == "tuple":
        yield from _parts(list(chain.from_iterable(values)))
    elif kind[0] == "array":
        for array in values:
            yield np.ascontiguousarray(array, kind[1]).reshape(-1).view(np.uint8).data
    elif kind[0].startswith("data"):
        for field in fields(values[0]):
            if field.name not in _LEFT_OUT:
                yield from _parts([getattr(value, field.name) for value in values])
