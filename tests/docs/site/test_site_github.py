"""GitHub's Markdown is adapted to Python-Markdown, and everything else stays unchanged."""

from __future__ import annotations

import pytest

from docs.making.site.github import for_python_markdown

CHANGED = {
    "a list after a paragraph": ("text\n- a\n- b\n", "text\n\n- a\n- b\n"),
    "a numbered list after one": ("text\n1. a\n2. b\n", "text\n\n1. a\n2. b\n"),
    "a table after a paragraph": ("text\n| a |\n|---|\n| 1 |\n", "text\n\n| a |\n|---|\n| 1 |\n"),
    "a list in a list": ("- a\n  - b\n    - c\n- d\n", "- a\n    - b\n        - c\n- d\n"),
    "a list in a numbered one": ("1. a\n   - b\n2. c\n", "1. a\n    - b\n2. c\n"),
    "an item of two lines": ("- a\n  and b\n- c\n", "- a\n    and b\n- c\n"),
    "a second paragraph of an item": ("10. a\n\n    more\n\nafter\n", "10. a\n\n    more\n\nafter\n"),
    "one of a bullet": ("- a\n\n  more\n\nafter\n", "- a\n\n    more\n\nafter\n"),
    "a list after a paragraph of an item": ("- a\n\n  more\n  - b\n", "- a\n\n    more\n\n    - b\n"),
    "code in an item": ("2. a\n\n   ```\n   x:\n       y\n   ```\n", "2. a\n\n    ```\n    x:\n        y\n    ```\n"),
    "an answer": ("<details><summary>A</summary>b</details>", '<details markdown="1"><summary>A</summary>b</details>'),
}
KEPT = {
    "a list after a blank line": "text\n\n- a\n- b\n",
    "a list after a heading": "## text\n- a\n",
    "a year at the beginning of a line": "The paper is of\n2016. It is good.\n",
    "a line that begins with a bar": "a |\n| b\n",
    "code that looks like a list": "```text\ntext\n- a\n  - b\n```\n",
    "code with a fence inside": "````text\n```\ntext\n- a\n```\n````\n",
    "an item that goes on to the left": "- a\nmore of a\n",
}


@pytest.mark.parametrize("text, wanted", CHANGED.values(), ids=CHANGED)
def test_what_is_changed(text: str, wanted: str) -> None:
    """Lists and tables get a blank line before them, nested lists four columns per level, and details Markdown."""
    assert for_python_markdown(text) == wanted


@pytest.mark.parametrize("text", KEPT.values(), ids=KEPT)
def test_what_is_kept(text: str) -> None:
    """Text that needs no change is kept exactly."""
    assert for_python_markdown(text) == text
