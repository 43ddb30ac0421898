"""The READMEs name what there is: every file of their folders, and no file or link that is gone."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pyrt.cli import _parsers

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("README.md"), *ROOT.glob("*/README.md"), ROOT / "scenes" / "REFERENCE.md"])
FOLDERS = {
    "kernels": ["*.h", "*.cl"],
    "scenes": ["*.json", "*.py", "*.md", "examples/*.py"],
    "textures": ["*.png", "*.py"],
    "tests": ["*.py"],
    "bench": ["*.py", "*.md"],
}
NOT_NAMED = {"README.md", "__init__.py", "__main__.py"}


def missing(text: str, page: Path) -> list[str]:
    """Links and paths in a page of Markdown that lead nowhere."""
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
    paths = re.findall(r"`((?:pyrt|kernels|scenes|textures|tests|bench)/[\w/]+\.\w+)`", text)
    return [link for link in links if not (page.parent / link).exists()] + [
        path for path in paths if not (ROOT / path).exists()
    ]


def unnamed(text: str, folder: Path, patterns: list[str]) -> list[str]:
    """Files of the folder that the page names neither so nor as `stem`."""
    files = [path for pattern in patterns for path in folder.glob(pattern) if path.name not in NOT_NAMED]
    return [path.name for path in files if path.name not in text and f"`{path.stem}`" not in text]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: f"{page.parent.name}/{page.name}")
def test_links_and_paths_lead_somewhere(page):
    assert missing(page.read_text(encoding="utf-8"), page) == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_is_named(folder):
    assert unnamed((ROOT / folder / "README.md").read_text(encoding="utf-8"), ROOT / folder, FOLDERS[folder]) == []


def test_what_leads_nowhere_or_is_not_named_is_noticed():
    text = "[a](README.md) [b](gone.md#there) `pyrt/cli.py` `pyrt/gone.py` [c](https://example.org)"
    assert missing(text, ROOT / "README.md") == ["gone.md", "pyrt/gone.py"]
    assert "cornell.json" in unnamed("showcase.json", ROOT / "scenes", ["*.json"])


def test_the_readme_has_every_verb_and_every_exit_code():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for verb in _parsers()[1]:
        assert f"pyrt {verb} " in text, verb
    codes = re.search(r"^Exit codes: (.*?)\n\n", text, re.MULTILINE | re.DOTALL)
    assert codes
    assert re.findall(r"\b\d+\b", codes[1]) == ["0", "1", "2", "3", "4", "5", "130"]
