"""`pyrt schema`: a JSON Schema that any validator can use, and that means the same as pyrt's own validation."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from pyrt.cli import main
from pyrt.schema_errors import validate, validate_objects
from pyrt.schema_reference import scene_reference

SCENES = sorted((Path(__file__).parents[2] / "scenes").glob("*.json"))


@pytest.fixture(scope="module")
def schema() -> Draft202012Validator:
    """What the verb prints, as a validator."""
    from contextlib import redirect_stdout
    from io import StringIO

    with redirect_stdout(StringIO()) as printed:
        assert main(["schema"]) == 0
    loaded = json.loads(printed.getvalue())
    Draft202012Validator.check_schema(loaded)
    return Draft202012Validator(loaded)


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_shipped_scenes_are_valid(path, schema):
    schema.validate(json.loads(path.read_text()))


def cornell() -> dict[str, Any]:
    return json.loads(next(path for path in SCENES if path.stem == "cornell").read_text())


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("film", "resolution"), [640]),
        (("film", "resolution"), [640, 0]),
        (("camera", "fov"), 180),
        (("camera", "fov"), "wide"),
        (("camera", "fovv"), 30),
        (("integrator", "spp"), 1.5),
        (("objects",), []),
        (("objects", 0, "type"), "cube"),
        (("objects", 0, "light"), {"radiance": [1, 1, -1]}),
    ],
    ids=str,
)
def test_what_pyrt_refuses_it_refuses(path, value, schema):
    scene = copy.deepcopy(cornell())
    *parents, last = path
    node: Any = scene
    for step in parents:
        node = node[step]
    node[last] = value
    assert not schema.is_valid(scene)
    if path != ("objects",):  # which is refused a little later
        assert validate(scene)[1] or validate_objects(scene["objects"])[1]


def test_the_reference_is_up_to_date(capsys):
    assert main(["schema", "--markdown"]) == 0
    assert capsys.readouterr().out == (SCENES[0].parent / "REFERENCE.md").read_text(encoding="utf-8"), (
        "run: python -m pyrt schema --markdown > scenes/REFERENCE.md"
    )


def test_the_reference_has_every_key_and_every_link_a_target(schema):
    text = scene_reference()
    for model in [schema.schema, *schema.schema["$defs"].values()]:
        for key, value in model["properties"].items():
            assert f"| `{key}` |" in text or "const" in value, key
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
    assert len(anchors) == len(headings) == len(schema.schema["$defs"]) + 1
    assert set(re.findall(r"\(#([^)]*)\)", text)) == anchors - {"the-file"}
