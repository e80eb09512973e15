"""Paths, commands and make targets in any text of the project exist: code, help, prototxt,
cards, settings.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator

import pytest

from netlib.files.paths import ROOT
from tests.documents import commands

TEXTS = re.compile(r"\.(py|md|prototxt|cfg|toml|yml|in)$|Makefile|^\.ci/|^\.gitignore$")
OTHERS = ("tests/", "CHANGELOG.md")  # made-up names; names of the past
ELSEWHERE = {  # built; installed; Caffe's; a user's
    "docs/hand.html",
    "name/__init__.py",
    "netlib/share",
    "python/caffe/io.py",
    "tools/extra",
}
CALL = re.compile(r"`((?:make|handpose|netlib|python|mpiexec) (?!-m tests)[^`←]+)`")
INCOMPLETE = re.compile(r"arguments are required|No module named 'tools\.[A-Z]+'")  # `netlib NAME`


@pytest.fixture(scope="module")
def files() -> list[str]:
    """The files under version control."""
    if not (ROOT / ".git").exists():
        pytest.skip("the project's files are not under version control here")
    done = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [name for name in done.stdout.split("\0") if (ROOT / name).is_file()]


def wrong_paths(text: str, files: list[str]) -> Iterator[str]:
    """The paths into folders of the project, and those of Python and Markdown files,
    that no file has.
    """
    folders = "|".join({name.split("/")[0] for name in files if "/" in name and name[0] != "."})
    end = r"(?![\w*{}/<\[])"
    inside = re.findall(rf"(?<![\w./*{{}}<$-])((?:{folders})/[\w.-]+(?:/[\w.-]+)*/?){end}", text)
    named = re.findall(rf"(?<![\w{{}}*<>%./:-])(\w[\w-]*(?:/[\w.-]+)+\.(?:py|md)){end}", text)
    known = "\n".join(["", *files, ""])
    for name in {path.rstrip("./") for path in [*inside, *named]} - ELSEWHERE:
        if not re.search(rf"[\n/]{re.escape(name)}(\.py)?[\n/]", known) and not name.endswith(
            "/x.prototxt"
        ):
            yield name


def wrong_commands(text: str) -> Iterator[str]:
    """The commands in backquotes that do not exist or do not accept their arguments."""
    for call in CALL.findall(text):
        found = commands.mistakes(" ".join(call.replace("...", "").split()))
        yield from (mistake for mistake in found if not INCOMPLETE.search(mistake))


def test_paths_and_commands_in_texts_exist(files: list[str]) -> None:
    found = []
    for name in files:
        if TEXTS.search(name) and not name.startswith(OTHERS):
            text = (ROOT / name).read_text(encoding="utf-8")
            found += [
                f"{name}: {fault}" for fault in [*wrong_paths(text, files), *wrong_commands(text)]
            ]
    assert found == []
