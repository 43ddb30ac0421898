"""What the verbs of the command line share: how a verb is declared, the types of values, and loading a scene."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from io import StringIO
from typing import TYPE_CHECKING, Any

from pyrt.errors import UsageError

if TYPE_CHECKING:
    from pyrt.scene import Scene

EXIT_CODES = """exit codes:
  0 done   1 failed   2 wrong usage   3 invalid scene   4 no usable OpenCL device
  5 stopped by a limit before the noise target, with a valid picture   130 interrupted"""

Verbs = Any  # argparse's type for them is private


def add_verb(
    verbs: Verbs, name: str, operands: str, run: Callable[[argparse.Namespace], int], text: str, examples: str
) -> argparse.ArgumentParser:
    """Declares a verb; its options are added to the parser that this returns.

    Args:
        operands: what stands behind the verb, for the usage line.
        run: does the work and returns the exit code.
        text: one line for the list of verbs.
        examples: lines `pyrt …`, each with what it does.
    """
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        prog=f"pyrt {name}",
        usage=" ".join(["pyrt", name, *operands.split(), "[options]"]),
        help=text,
        description=f"{text[0].upper()}{text[1:]}.",
        epilog=f"examples:\n{examples}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


def add_scene(
    parser: argparse.ArgumentParser,
    metavar: str = "SCENE",
    text: str = "a scene file, a model (GLB, glTF, OBJ, PLY, STL, OFF), or example:NAME",
) -> None:
    """Adds SCENE and --set, which `load` reads."""
    parser.add_argument("scene", metavar=metavar, help=text)
    parser.add_argument(
        "--set",
        metavar="PATH=VALUE",
        type=setting,
        action="append",
        help="replace a value of the scene, such as camera.fov=30",
    )


def add_display(parser: Any) -> None:
    """Adds --exposure and --view, which `check_outputs` checks; to a parser or a group of it."""
    parser.add_argument(
        "--exposure", type=number, default=0.0, metavar="STOPS", help="brighten PNG and JPEG by 2^STOPS"
    )
    parser.add_argument(
        "--view", metavar="NAME", help="how PNG and JPEG show what is brighter than white: aces, srgb or raw"
    )


def check_outputs(paths: list[str], args: argparse.Namespace) -> None:
    """Raises UsageError unless all these files can be written, and --exposure and --view have one that they are for."""
    from pyrt.image_io import check_output, is_display

    for path in paths:
        check_output(path, args.exposure, args.view)
    if (args.exposure or args.view) and paths and not any(map(is_display, paths)):
        raise UsageError(
            f"--exposure, --view: expected an output ending in .png or .jpg; {paths[0]} holds the light as it is"
        )


def load(args: argparse.Namespace) -> Scene:
    """The scene that the options name; its warnings go to stderr."""
    from pyrt.scene_io import load_scene

    scene = load_scene(args.scene, overrides=dict(args.set or ()), size=getattr(args, "size", None))
    for text in scene.warnings:
        warn(text)
    return scene


def say(text: str) -> None:
    """Prints to stderr. That nobody can read it is no reason to stop the work."""
    with suppress(OSError):
        print(text, file=sys.stderr or StringIO(), flush=True)


def warn(text: str) -> None:
    """A warning on stderr."""
    say(f"warning: {text}")


def nearest(name: str, valid: Iterable[str]) -> str:
    """The end of a sentence about an unknown name: the nearest valid one, or all of them."""
    from difflib import get_close_matches

    names = list(valid)
    close = get_close_matches(name, names, 1)
    return f"; did you mean {close[0]}?" if close else f"; there are {', '.join(sorted(names))}"


# --- types of values --------------------------------------------------------------------------------------------------


def whole(text: str) -> int:
    """64 → 64."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected a whole number, got "{text}"') from None


def number(text: str) -> float:
    """0.01 → 0.01."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected a number, got "{text}"') from None


def size(text: str) -> tuple[int, int]:
    """640x480 → (640, 480)."""
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected WIDTHxHEIGHT such as 640x480, got "{text}"') from None


def crop(text: str) -> tuple[int, int, int, int]:
    """0,0,320,240 → (0, 0, 320, 240)."""
    try:
        x0, y0, x1, y1 = (int(number) for number in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected X0,Y0,X1,Y1 such as 0,0,320,240, got "{text}"') from None
    return x0, y0, x1, y1


def seconds(text: str) -> float:
    """90, 90s, 1.5m or 2h → seconds."""
    number, unit = (text[:-1], text[-1]) if text[-1:] in ("s", "m", "h") else (text, "s")
    try:
        return float(number) * {"s": 1, "m": 60, "h": 3600}[unit]
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected a time such as 90, 90s, 5m or 2h, got "{text}"') from None


def sample_range(text: str) -> tuple[int, int]:
    """16:32 → (16, 32)."""
    first, _, end = text.partition(":")
    try:
        return int(first), int(end)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected FIRST:END such as 0:64, got "{text}"') from None


def setting(text: str) -> tuple[str, Any]:
    """camera.fov=40 → ("camera.fov", 40). What is not JSON is a string."""
    path, equals, value = text.partition("=")
    if not (equals and path):
        raise argparse.ArgumentTypeError(f'expected PATH=VALUE such as camera.fov=40, got "{text}"')
    try:
        return path, json.loads(value)
    except (ValueError, RecursionError):
        return path, value
