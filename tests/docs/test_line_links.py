"""docs/making/line_links.py, also in combination with the other generated text."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.making import documents, line_links


@pytest.fixture()
def document(tmp_path: Path) -> Path:
    """The path of a document in a folder that also contains a module."""
    (tmp_path / "box.py").write_text("A = 1\n\n\nclass Box:\n    def fill(self) -> None: ...\n")
    return tmp_path / "page.md"


@pytest.mark.parametrize(
    ("text", "made"),
    [
        ('[it](box.py "Box")', '[it](box.py#L4 "Box")'),
        (
            '[`it`](box.py#L40 "Box.fill") and [A](box.py#L1 "A").',
            '[`it`](box.py#L5 "Box.fill") and [A](box.py#L1 "A").',
        ),
        ("[it](box.py), [it](box.py#L7)", None),
        ('[it](box.py "a box of A")', None),
        ('[it](https://here/box.py#L9 "Box"), [it](none.py "Box"), ![it](box.svg "Box")', None),
        ('`[it](box.py "Box")`\n```text\n[it](box.py "Box")\n```\n', None),
    ],
)
def test_lines_are_put(document: Path, text: str, made: str | None) -> None:
    """A link whose title names a definition in an existing file gets its line, except in code."""
    assert line_links.current(text, document) == (made or text)


def test_a_name_that_is_gone(document: Path) -> None:
    """A name that does not exist is reported with the document and the file."""
    with pytest.raises(ValueError, match=r"page\.md:1: box\.py has no Bag, which a link names"):
        line_links.current('[it](box.py#L4 "Bag")', document)


def test_code_and_links_of_one_document(document: Path) -> None:
    """Code and links are both updated, a second run changes nothing, and links in the code shown keep their lines."""
    mark = "<!-- code: docs/making/line_links.py docstring -->\n"
    text = documents.current(f'{mark}\n[it](box.py "Box")\n', document)
    assert text.startswith(f'{mark}```python\n"""Links to a line') and text.endswith('[it](box.py#L4 "Box")\n')
    assert 'kinematics.py#L79 "Kinematics.backward")' in text
    assert documents.current(text, document) == text
