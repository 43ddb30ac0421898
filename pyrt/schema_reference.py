"""The scene format as a page of Markdown, `scenes/REFERENCE.md`: made from the models that check scene files."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from pyrt.schema import Object, SceneModel
from pyrt.schema_errors import CONTAINERS

_HEAD = """\
# Scene reference

Made by `pyrt schema --markdown` from what checks scene files; [README.md](README.md) tells how to write them. The words
below are those of the error messages. Unknown keys are errors, and null is as good as leaving out a key whose default
is null.
"""
_NOTHING = object()  # a value that no key accepts

Model = type[BaseModel]


def scene_reference() -> str:
    """All keys of a scene file with what they may hold, their defaults, units and meaning."""
    sections = dict(_sections("", SceneModel))
    return "\n".join([_HEAD, *sections.values()])


def _sections(path: str, model: Model) -> Iterator[tuple[str, str]]:
    """Headings and sections of the model at a path of the scene file, and of all models within it."""
    inner = {key: _models(field.annotation) for key, field in model.model_fields.items()}
    headings = {key: [_heading(_join(path, key), part) for part in parts] for key, parts in inner.items()}
    heading = _heading(path, model)
    yield heading, _section(heading, model, headings)
    for key, parts in inner.items():
        for part in parts:
            yield from _sections(_join(path, key), part)


def _models(annotation: Any) -> list[Model]:
    """The models in a type such as list[A | B] or C | None."""
    if isinstance(annotation, type) and get_origin(annotation) is None and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


def _join(path: str, key: str) -> str:
    """The path of what is in a key, as error messages write it."""
    entry = "" if path or key not in CONTAINERS else "[i]" if key in ("lights", "objects") else ".NAME"
    return f"{path}.{key}{entry}".removeprefix(".")


def _heading(path: str, model: Model) -> str:
    kind = model.model_fields.get("type")
    return f"{path}, {_alternatives(kind)}" if kind and kind.is_required() else path or "The file"


def _section(heading: str, model: Model, headings: dict[str, list[str]]) -> str:
    about = (
        f"{model.__doc__} Needs a `material_name`, a `light` or both." if issubclass(model, Object) else model.__doc__
    )
    rows = [
        f"| `{key}` | {_value(model, key, headings[key])} | {_default(field)} | {field.description or ''} |"
        for key, field in model.model_fields.items()
        if not (key == "type" and field.is_required())
    ]
    return "\n".join(
        [f"## {heading}", "", str(about), "", "| key | holds | default | |", "|---|---|---|---|", *rows, ""]
    )


def _value(model: Model, key: str, headings: list[str]) -> str:
    """What may stand in a key: links to other sections, or the words of the error message."""
    if headings:
        return ", ".join(f"[{heading}](#{_anchor(heading)})" for heading in headings)
    try:
        model.model_validate({key: _NOTHING})
    except ValidationError as error:
        return next(found["msg"] for found in error.errors() if found["loc"] == (key,))
    raise AssertionError(f"{key} accepts anything")


def _alternatives(field: FieldInfo) -> str:
    return " or ".join(json.dumps(value) for value in get_args(field.annotation))


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.get_default()
    return f"`{json.dumps({} if isinstance(value, BaseModel) else value)}`"


def _anchor(heading: str) -> str:
    """The name that renderers of Markdown give a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
