"""Reads scene files as strict JSON, and applies overrides such as `camera.fov=40`."""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from pyrt.errors import PyrtError, SceneError
from pyrt.files import read_bytes
from pyrt.room import available
from pyrt.schema_errors import CONTAINERS, quote, suggestion

_EXPANSION = 8  # bytes of memory for one in the file, measured with lists of objects
_UNASKED = 1 << 20  # bytes of a file: to ask how much memory there is takes longer than to read it


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The JSON object in a file. NaN and Infinity come back as floats, so that validation can name their place.

    Raises:
        SceneError: unreadable file, not UTF-8, not JSON (with line and column), repeated keys, not an object.
        PyrtError: it would not fit into memory.
    """
    _require_room(path)
    content = read_bytes(path)
    faults: list[str] = []
    printable: set[str] = set()  # most objects have the keys of others

    def checked(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        entry = dict(pairs)
        if len(entry) == len(pairs) and printable.issuperset(entry):
            return entry
        for key, count in Counter(key for key, _ in pairs).items():
            if count > 1:
                faults.append(f"{path}: the key {quote(key)} occurs {count} times in one object")
            if not key.isprintable():
                faults.append(f"{path}: the key {key!a} holds characters that cannot be printed")
        printable.update(filter(str.isprintable, entry))
        return entry

    try:
        raw = json.loads(content.decode("utf-8-sig"), object_pairs_hook=checked)
    except UnicodeDecodeError as error:
        byte = f"the byte {content[error.start]:#04x} at position {error.start}"
        raise SceneError(f"{path}: expected UTF-8 text, found {byte}") from None
    except json.JSONDecodeError as error:
        reason = error.msg.lower().removesuffix(" at") if content.strip() else "the file is empty"
        raise SceneError(f"{path}: line {error.lineno}, column {error.colno}: not valid JSON: {reason}") from None
    except RecursionError:
        raise SceneError(f"{path}: arrays or objects are nested too deeply") from None
    except ValueError:
        raise SceneError(f"{path}: a number has too many digits") from None
    if faults:
        raise SceneError(faults)
    if not isinstance(raw, dict):
        raise SceneError(f"{path}: expected a JSON object, got {quote(raw)}")
    return raw


def _require_room(path: str | os.PathLike[str]) -> None:
    size = os.path.getsize(path) if os.path.isfile(path) else 0
    if size > _UNASKED and size * _EXPANSION > (free := available()):
        need = f"{size * _EXPANSION / 2**30:.3g} GiB of free memory to read {size >> 20} MiB of JSON"
        raise PyrtError(f"{path}: expected about {need}, found {free / 2**30:.3g} GiB")


def plain(value: Any) -> Any:
    """A deep copy made of what JSON knows: of mappings, sequences, paths and numpy's arrays and scalars.

    Raises SceneError for anything else, for unprintable keys, and for a structure that contains itself.
    """
    try:
        return _plain(value)
    except RecursionError:
        raise SceneError("arrays or objects are nested too deeply") from None


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key in value:
            if not (isinstance(key, str) and key.isprintable()):
                raise SceneError(f"expected a printable string as key, got {key!a}")
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if value is None or isinstance(value, (str, int, float)):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise SceneError(f"expected numbers, strings, lists or dicts, got a value of type {type(value).__name__}")


def override(raw: dict[str, Any], path: str, value: Any) -> None:
    """Sets `raw` at a dotted path: keys and array indices, such as `objects.0.translate` or `objects[0].translate`.

    A key with dots or brackets stands in quotes: `materials["Steel.001"].color`.

    Missing keys are added, for validation to judge; only entries (a texture, an object) have to be there.
    Raises SceneError for a path into something that is not there.
    """
    if not path.isprintable():
        raise SceneError(f"{path!a} holds characters that cannot be printed")
    *parents, last = _steps(path)
    node: Any = raw
    for depth, step in enumerate(parents):
        if isinstance(node, dict) and not (depth == 1 and parents[0] in CONTAINERS):
            node.setdefault(step, [] if depth == 0 and step in ("lights", "objects") else {})
        node = node[_key(node, path, parents[:depth], step)]
    key = last if isinstance(node, dict) else _key(node, path, parents, last)
    node[key] = plain(value)


def _steps(path: str) -> list[str]:
    """The keys of a path, as `json_path` writes it."""
    quoted = re.compile(r'\["((?:[^"\\]|\\.)*)"\]')
    try:
        names = [json.loads(f'"{name}"') for name in quoted.findall(path)]
    except ValueError:
        raise SceneError(f"{path}: a key in quotes is no JSON string") from None
    dotted = re.sub(r"\[(\d+)\]", r".\1", quoted.sub(".\0", path)).removeprefix(".")
    return [names.pop(0) if step == "\0" else step for step in dotted.split(".")]


def _key(node: Any, path: str, above: list[str], step: str) -> str | int:
    """`step` as a key or index that exists in `node`."""
    where = f"{path}: no {quote(step)} in {'.'.join(above)}"
    if isinstance(node, dict):
        if step not in node:
            raise SceneError(where + suggestion(step, node))
        return step
    if not isinstance(node, list):
        raise SceneError(f"{where}, which is {quote(node)}")
    if not (step.isdecimal() and int(step) < len(node)):
        expected = f"; expected an index from 0 to {len(node) - 1}" if node else ", which is empty"
        raise SceneError(where + expected)
    return int(step)
