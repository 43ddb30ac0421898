"""The command line: `python -m pyrt VERB …`, or `pyrt VERB …`. Heavy imports wait until a verb needs them.

Each verb lives in one of the `cli_*` modules: its options, its examples, and the function that runs it.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, TextIO

from pyrt import __version__, cli_denoise, cli_device, cli_image, cli_merge, cli_render, cli_scene
from pyrt.cli_options import EXIT_CODES, nearest, say
from pyrt.errors import PyrtError, SceneError

_VERBS = (cli_render, cli_merge, cli_image, cli_denoise, cli_scene, cli_device)  # in the order of --help

_EXAMPLES = """examples:
  pyrt render example:cornell                   writes cornell.exr and cornell.png
  pyrt render scene.json --spp 256 -o glass.png
  pyrt VERB --help                              tells more about a verb, with examples
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code, whatever happens to the command's streams."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text
    status = _finished(list(sys.argv[1:] if argv is None else argv))
    unwritten = _flush(sys.stdout)
    if unwritten:
        say(f"pyrt: standard output: {unwritten}")
    _flush(sys.stderr)
    return status or int(bool(unwritten))


def _finished(words: list[str]) -> int:
    """Runs the command; returns its exit code, of an error too."""
    try:
        return _run(words)
    except SystemExit as stop:  # argparse, after --help, --version or wrong usage
        return int(stop.code or 0)
    except PyrtError as error:
        say(f"pyrt: {error}" if not isinstance(error, SceneError) else str(error))
        return error.exit_code
    except MemoryError as error:
        say(f"pyrt: not enough memory; {error}".removesuffix("; "))
        return 1
    except BrokenPipeError:
        return 0  # whoever read the output has seen enough
    except OSError as error:
        say(f"pyrt: {error.filename or 'standard output'}: {(error.strerror or str(error)).lower()}")
        return 1
    except KeyboardInterrupt:
        say("pyrt: interrupted")
        return 130


def _run(words: list[str]) -> int:
    parser, verbs = _parsers()
    if not words:
        say(parser.format_help())
        return 2
    if words[0] in verbs:
        _check_options(verbs[words[0]], words[1:])
    elif not words[0].startswith("-"):
        found = "; did you mean pyrt render?" if os.path.exists(words[0]) else nearest(words[0], verbs)
        parser.error(f'no verb "{words[0]}"{found}')
    args = parser.parse_args(words)
    if any(value == [] or (isinstance(value, list) and [] in value) for value in vars(args).values()):
        parser.error("an option has the value --")  # `--spp=--`, which Python's argparse before 3.13 takes for []
    status: int = args.run(args)
    return status


def _check_options(parser: argparse.ArgumentParser, words: list[str]) -> None:
    """Refuses unknown options before argparse does, with the nearest one that there is."""
    known = set(re.findall(r"^  (?:-\w[^-]*, )?(--[\w-]+)", parser.format_help(), re.MULTILINE))
    for word in words[: words.index("--")] if "--" in words else words:
        name = word.partition("=")[0]
        if name.startswith("--") and name not in known:
            parser.error(f"no option {name}{nearest(name, known)}")


class _Parser(argparse.ArgumentParser):
    """Writes as `say` does. Older versions of argparse fail on a stream that is full, and so with another exit code."""

    def _print_message(self, message: str, file: Any = None) -> None:
        with suppress(OSError):
            super()._print_message(message, file)


def _parsers() -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """The parser of everything, and those of the verbs by name."""
    parser = _Parser(
        prog="pyrt",
        usage="pyrt VERB ...",
        description="A ray tracer that Python drives and OpenCL runs.",
        epilog=f"{_EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pyrt {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="", required=True)
    for module in _VERBS:
        module.add_verbs(verbs)
    return parser, dict(verbs.choices)


def _flush(stream: TextIO | None) -> str:
    """Writes what a stream holds; returns why that failed, or "".

    A stream that failed is replaced by nothing, or Python would fail with it on leaving.
    """
    if stream is None:  # closed from the start
        return ""
    try:
        stream.flush()
    except OSError as error:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, stream.fileno())
        os.close(nothing)
        return "" if isinstance(error, BrokenPipeError) else (error.strerror or str(error)).lower()
    return ""
