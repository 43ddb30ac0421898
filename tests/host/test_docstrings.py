"""Everything public says what it is for, and each argument what it means."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

import pytest

import pyrt


def public() -> Iterator[tuple[str, Any]]:
    """The public classes and functions, and the public methods and properties of the classes."""
    for name in pyrt.__all__:
        thing = getattr(pyrt, name)
        if not callable(thing):
            continue
        yield name, thing
        for inner, member in vars(thing).items() if inspect.isclass(thing) else ():
            if not inner.startswith("_") and hasattr(member, "__get__"):
                yield f"{name}.{inner}", member


PUBLIC = dict(public())


def undocumented(thing: Any) -> list[str]:
    """Arguments or fields that a docstring with a list of them leaves out; "" if there is no docstring."""
    text = inspect.getdoc(thing) or ""
    if not text:
        return [""]
    listed = callable(thing) and ("Args:" in text or "Attributes:" in text)
    names = [name for name in inspect.signature(thing).parameters if name != "self"] if listed else []
    return [name for name in names if not re.search(rf"^ +(\w+, )*{name}(, \w+)*: |\. {name}: ", text, re.MULTILINE)]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_documented(name):
    assert undocumented(PUBLIC[name]) == []


def test_what_is_not_documented_is_noticed():
    def listed(a: int, b: int) -> None:
        """Does it.

        Args:
            a: one.
        """

    assert undocumented(listed) == ["b"]
    assert undocumented(lambda: None) == [""]
    assert {"RayTracer.locate", "Renderer.render", "RayMeshIntersector.tracer", "Result.save"} <= set(PUBLIC)
