"""The command line without rendering: help, wrong usage, and streams, places and locales that get in the way."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pyrt.cli import _parsers, main

SCENE = "example:cornell"
PACKAGE = Path(__file__).parents[2]
VERBS = tuple(_parsers()[1])


def shell(command: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs a shell command in which `pyrt` is `python -m pyrt`, in a folder; stops it after a minute."""
    env = {**os.environ, "PYTHONPATH": str(PACKAGE), **environment}
    script = f'pyrt() {{ "{sys.executable}" -m pyrt "$@"; }}\n{command}'
    return subprocess.run(["bash", "-c", script], cwd=folder, env=env, capture_output=True, timeout=60, text=True)


def test_alone_it_prints_short_help(capsys):
    assert main([]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert all(f"    {verb} " in err for verb in VERBS)
    assert len(err.splitlines()) < 40


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_teaches_by_example(verb, capsys):
    assert main([verb, "--help"]) == 0
    text = capsys.readouterr().out
    assert re.search(rf"^  pyrt {verb}\b", text, re.MULTILINE)
    assert "exit codes:\n  0 done" in text
    assert text.isascii()  # or it could not be printed everywhere
    assert max(map(len, text.splitlines())) <= 120


@pytest.mark.parametrize("verb", VERBS)
def test_examples_of_the_help_have_options_that_there_are(verb):
    parser, verbs = _parsers()
    commands = re.findall(r"^  pyrt ((?:\S+ ?)+)", verbs[verb].format_help(), re.MULTILINE)
    assert commands
    for command in commands:
        parser.parse_args(shlex.split(re.split(r">|&&|\|\|", command)[0]))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendr"], 'no verb "rendr"; did you mean render?'),
        (["frobnicate"], 'no verb "frobnicate"; there are d'),
        (["render"], "required: SCENE"),
        (["render", SCENE, "--nose", "0.1"], "no option --nose; did you mean --noise?"),
        (["render", SCENE, "--nose=0.1"], "no option --nose; did you mean --noise?"),
        (["render", SCENE, "--zzzz"], "no option --zzzz; there are --"),
        (["info", SCENE, "--spp", "3"], "no option --spp"),
        (["render", SCENE, "--expo", "1"], "no option --expo; did you mean --exposure?"),  # no abbreviations
        (["render", SCENE, "two"], "unrecognized arguments: two"),
        (["render", SCENE, "--size", "12"], 'expected WIDTHxHEIGHT such as 640x480, got "12"'),
        (["render", SCENE, "--time", "soon"], 'expected a time such as 90, 90s, 5m or 2h, got "soon"'),
        (["render", SCENE, "--set", "camera.fov"], "expected PATH=VALUE such as camera.fov=40"),
        (["render", SCENE, "--spp=--"], "an option has the value --"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_wrong_usage_is_one_sentence_with_the_nearest_name(arguments, message, capsys):
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    usage, sentence = err.splitlines()
    assert usage.startswith("usage: pyrt ")
    assert message in sentence


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("command", "status", "message"),
    [
        ("pyrt validate example:cornell >/dev/full", 1, "pyrt: standard output: no space left on device\n"),
        ("pyrt validate missing.json 2>/dev/full", 3, ""),
        ("pyrt rendr 2>/dev/full", 2, ""),
        ("pyrt validate missing.json 2>&-", 3, ""),
        ("pyrt validate example:cornell >&-", 0, ""),
    ],
)
def test_streams_that_cannot_be_written_to(command, status, message, tmp_path):
    done = shell(command, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (status, "", message)


@pytest.mark.parametrize("command", ["pyrt --help", "pyrt info example:cornell"])
def test_a_reader_that_leaves_early_is_no_error(command, tmp_path):
    done = shell(f"{command} | true; echo ${{PIPESTATUS[0]}}", tmp_path)
    assert (done.stdout, done.stderr) == ("0\n", "")


def test_a_locale_without_unicode(tmp_path):
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = shell("pyrt validate $'\\xc3\\xa9.json'; pyrt render --help", tmp_path, **ascii_only)
    assert done.returncode == 0
    assert "cannot be read: no such file or directory" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout.isascii()
