"""The chapters of the book have a common form."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

BOOK = Path(__file__).resolve().parents[2] / "docs" / "book"
CHAPTERS = sorted(BOOK.glob("[0-9]*_*.md"), key=lambda path: int(path.name.split("_")[0]))
MAX_WORDS = 2500


def test_chapters_are_numbered_from_0() -> None:
    """The chapters are numbered from 0 in their file names and titles."""
    assert [int(path.name.split("_")[0]) for path in CHAPTERS] == list(range(11))
    for number, path in enumerate(CHAPTERS):
        assert path.read_text(encoding="utf-8").startswith(f"# {number}. ")


@pytest.mark.parametrize("path", CHAPTERS[1:], ids=lambda path: path.stem)
def test_a_chapter_has_a_goal_a_recap_three_questions_and_a_picture(path: Path) -> None:
    """A chapter starts with its goal, ends with a recap and three questions with answers, and has a picture."""
    text = path.read_text(encoding="utf-8")
    assert text.split("\n\n")[1].startswith("> **Goal.**")
    assert text.count("## Recap") == 1
    questions = text[text.index("## Recap") :]
    assert re.findall(r"^(\d)\. ", questions, re.MULTILINE) == ["1", "2", "3"]
    assert questions.count("<summary>Answer</summary>") == 3
    assert "](../images/book/" in text


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_a_chapter_is_short(path: Path) -> None:
    """A chapter has at most 2500 words outside code."""
    prose = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    assert len(prose.split()) <= MAX_WORDS


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_a_reader_imports_nothing_of_the_tests(path: Path) -> None:
    """What a chapter needs of the recordings of Caffe is in the book's helpers."""
    assert not re.search(r"^>>> (from|import) tests\b", path.read_text(encoding="utf-8"), re.MULTILINE)


def test_every_picture_of_the_book_is_shown() -> None:
    """Every file in docs/images/book is used."""
    text = "".join(path.read_text(encoding="utf-8") for path in BOOK.parent.rglob("*.md"))
    shown = set(re.findall(r"images/book/(\w+)\.svg", text))
    assert shown == {path.stem for path in (BOOK.parent / "images" / "book").glob("*.svg")}
