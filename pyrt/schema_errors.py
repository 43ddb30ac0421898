"""Validates a scene against the schema and words every problem as one sentence."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable
from functools import cache, lru_cache
from typing import Any

from pydantic import ValidationError

from pyrt.schema import ObjectModel, SceneModel, json_schema

Location = tuple[int | str, ...]

_UNIONS = {"textures": "texture type", "materials": "material type", "objects": "object type", "lights": "light type"}
CONTAINERS = tuple(_UNIONS)  # sections made of entries
_TYPES = dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "an object") | {"list_type": "an array"}
_MAX_QUOTE = 60
_MAX_NAMES = 10


def validate(raw: dict[str, Any]) -> tuple[SceneModel, list[str]]:
    """Validates a parsed scene file, but not its objects, which may be many: see `validate_objects`.

    Returns:
        What is valid of it, whole sections or entries; and one sentence per problem, each starting with its JSON path.
    """
    model, _, problems = _validated({**raw, "objects": []} if isinstance(raw.get("objects"), list) else raw)
    return model, problems


def validate_objects(entries: list[Any], first: int = 0) -> tuple[list[tuple[int, ObjectModel]], list[str]]:
    """Validates a part of the list of objects, from the index `first` on. Returns the valid ones with their indices,
    and the problems."""
    model, broken, problems = _validated({"objects": entries}, first)
    indices = (i for i in range(len(entries)) if ("objects", i) not in broken)
    return [(first + i, shape) for i, shape in zip(indices, model.objects, strict=True)], problems


def _validated(raw: dict[str, Any], first: int = 0) -> tuple[SceneModel, set[Location], list[str]]:
    """What is valid, the places of what is not, and the problems; `first`: index of the first object."""
    try:
        return SceneModel.model_validate(raw), set(), []
    except ValidationError as invalid:
        errors = invalid.errors(include_url=False)
    broken: set[Location] = {e["loc"][: 2 if e["loc"][0] in CONTAINERS else 1] for e in errors}
    for error in errors:
        if first and error["loc"][0] == "objects":
            error["loc"] = ("objects", first + int(error["loc"][1]), *error["loc"][2:])
    return SceneModel.model_validate(_without(raw, broken)), broken, [_sentence(e) for e in errors]


def quote(value: Any) -> str:
    """A value as JSON, shortened."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except (ValueError, RecursionError):
        text = "a value that JSON cannot hold"
    return text if len(text) <= _MAX_QUOTE else text[: _MAX_QUOTE - 3] + "..."


def suggestion(name: object, valid: Iterable[str]) -> str:
    """The end of a sentence about an unknown name: the nearest valid one, or all of them."""
    return _suggestion(str(name), tuple(valid))


@lru_cache(1024)  # a million objects may have the same wrong key
def _suggestion(name: str, names: tuple[str, ...]) -> str:
    close = difflib.get_close_matches(name, names, 1)
    if close:
        return f"; did you mean {quote(close[0])}?"
    shown = [quote(n) for n in names[:_MAX_NAMES]] + ["..."] * (len(names) > _MAX_NAMES)
    return f"; expected one of {', '.join(shown)}" if names else "; there is none"


def json_path(location: Location) -> str:
    """`objects[3].light.radiance` for ("objects", 3, "light", "radiance")."""
    path = ""
    for step in location:
        if isinstance(step, str) and re.fullmatch(r"[\w-]+", step):
            path += f".{step}"
        else:
            path += f"[{quote(step)}]"
    return path.removeprefix(".")


def _without(raw: dict[str, Any], broken: set[Location]) -> dict[str, Any]:
    valid: dict[str, Any] = {"objects": []}
    for key, value in raw.items():
        if (key,) in broken:
            continue
        if isinstance(value, list):
            valid[key] = [entry for i, entry in enumerate(value) if (key, i) not in broken]
        else:
            valid[key] = {name: entry for name, entry in value.items() if (key, name) not in broken}
    return valid


def _sentence(error: Any) -> str:
    location, kind, found = error["loc"], error["type"], error["input"]
    union = location[0] in _UNIONS
    # in a union of types, pydantic puts the type's name after the entry
    path = json_path(location[:2] + location[3:] if union else location)
    parent = path.rpartition(".")[0]
    if kind == "missing":
        return f"{parent}: missing key {quote(location[-1])}".removeprefix(": ")
    if kind == "extra_forbidden":
        return f"{path}: unknown key{suggestion(location[-1], _node(location[:-1])['properties'])}"
    if kind == "union_tag_not_found":
        return f'{path}: missing key "type"{suggestion("", _node(location)["discriminator"]["mapping"])}'
    if kind == "union_tag_invalid":
        names = _node(location)["discriminator"]["mapping"]
        return f"{path}.type: no {_UNIONS[location[0]]} {quote(found['type'])}{suggestion(found['type'], names)}"
    if kind == "sentence":
        return f"{path}: {error['msg']}"
    return f"{path}: expected {_TYPES.get(kind, error['msg'])}, got {quote(found)}"


@cache
def _schema() -> dict[str, Any]:
    return json_schema()


def _node(location: Location) -> dict[str, Any]:
    """The JSON Schema of what is at one of pydantic's locations."""
    schema = _schema()
    node: dict[str, Any] = schema
    for step in location:
        if "discriminator" in node:
            node = {"$ref": node["discriminator"]["mapping"][step]}
        elif step in node.get("properties", {}):
            node = node["properties"][step]
        else:
            node = node["items"] if "items" in node else node["additionalProperties"]
        node = node["anyOf"][0] if "anyOf" in node else node
        if "$ref" in node:
            node = schema["$defs"][node["$ref"].rpartition("/")[2]]
    return node
