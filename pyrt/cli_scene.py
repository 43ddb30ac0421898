"""The verbs about scenes: `info`, `validate` and `schema`."""

from __future__ import annotations

import argparse
import json

from pyrt.cli_options import Verbs, add_scene, add_verb, load

_INFO_EXAMPLES = """\
  pyrt info scenes/cornell.json                 triangles, memory, features and why
  pyrt info example:showcase --set film.resolution=[1920,1080]
  pyrt render scene.json --noise 0.01 --aov z --dry-run   the memory of exactly that, and more
"""
_VALIDATE_EXAMPLES = """\
  pyrt validate scene.json                      every mistake at once, one sentence each
  pyrt validate scene.json && pyrt render scene.json
"""
_SCHEMA_EXAMPLES = """\
  pyrt schema > scene.schema.json               for editors that check and complete
  pyrt schema --markdown                        for reading: scenes/REFERENCE.md
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `info`, `validate` and `schema`."""
    text = "what a scene holds, and which features it compiles in"
    add_scene(add_verb(verbs, "info", "SCENE", _info, text, _INFO_EXAMPLES))
    text = "check a scene and the files it names, all errors at once"
    add_scene(add_verb(verbs, "validate", "SCENE", _validate, text, _VALIDATE_EXAMPLES))
    schema = add_verb(verbs, "schema", "", _schema, "print the JSON Schema of a scene file", _SCHEMA_EXAMPLES)
    schema.add_argument("--markdown", action="store_true", help="print the same as a page of tables")


def _info(args: argparse.Namespace) -> int:
    from pyrt.info import scene_report

    print(scene_report(load(args)))
    return 0


def _validate(args: argparse.Namespace) -> int:
    scene = load(args)
    print(f"{args.scene}: valid, {len(scene.shapes)} objects")
    return 0


def _schema(args: argparse.Namespace) -> int:
    if args.markdown:
        from pyrt.schema_reference import scene_reference

        print(scene_reference(), end="")
        return 0
    from pyrt.schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0
