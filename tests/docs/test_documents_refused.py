"""Documents with errors are reported in one line with file and line number, and are not changed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.making import __main__ as making
from docs.making import documents
from netlib.files.paths import ROOT
from tests.support.running import run_tool

RELU = "<!-- code: layers/activation/relu.py ReLU.reshape -->\n"
F = "```"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a\n\n<!-- code: netlib/blob.py Bob -->\n", "x.md:3: netlib/blob.py has no Bob"),
        ("a\n<!-- code: nowhere/x.py Bob -->\n", "x.md:2: cannot read nowhere/x.py: No such file or directory"),
        ("<!-- code: tests/caffe.d/x.py -->\n", "x.md:1: cannot read tests/caffe.d/x.py: No such file or directory"),
        ("<!-- code: ../../etc/x.conf -->\n", "x.md:1: ../../etc/x.conf is no file of this project"),
        ("<!-- code: /etc/x.conf -->\n", "x.md:1: /etc/x.conf is no file of this project"),
        ("<!-- code: exercises/recorded.npz -->\n", "x.md:1: cannot read exercises/recorded.npz: not"),
        ("<!-- code: prototxt/nyu_deploy.prototxt FC1 -->\n", "x.md:1: prototxt/nyu_deploy.prototxt has no names"),
        (f"{RELU}{F}python\nold\n\nmore text\n", "x.md:1: the block under this mark has no end"),
        (f"{RELU}{F}python\nold\n\nmore\n\n{F}python\nx\n{F}\n", "x.md:1: the block under this mark has no end before"),
        (f"{RELU}{F}`python\nold\n{F}`\n", "x.md:1: the block under this mark has no end"),
        ("<!-- exercises: lst -->\n<!-- end -->\n", "x.md:1: no 'lst' is made; expected list or example"),
        ("<!-- exercises: list -->\n| |\n", "x.md:1: this mark has no <!-- end -->"),
        ("\n\n[a](../netlib/blob.py \"Bob\")", "x.md:3: blob.py has no Bob, which a link names"),
    ],
)
def test_a_mark_that_is_wrong(text: str, said: str) -> None:
    """A wrong mark is reported with the document, the line and the reason."""
    with pytest.raises(ValueError) as error:
        documents.current(text, ROOT / "docs" / "x.md")
    assert str(error.value).startswith(f"docs/{said}") and str(error.value).isprintable()


def test_a_block_at_the_very_end() -> None:
    """A block whose closing fence ends the file without a newline is replaced."""
    made = documents.current(f"{RELU}{F}python\nold\n{F}", ROOT / "docs" / "x.md")
    assert "top[0].reshape(bottom[0].shape)" in made and made.endswith(f"\n{F}\n") and "old" not in made


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A temporary project of which only documents are made."""
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    monkeypatch.setattr(making, "PIECES", {"documents": documents.made})
    yield tmp_path


def test_a_document_that_is_no_text(folder: Path) -> None:
    """A document that is not UTF-8 is reported with its name and the position of the byte."""
    (folder / "x.md").write_bytes(b"caf\xe9\n" + RELU.encode())
    assert run_tool("docs.making.__main__", status=1).err == "error: x.md: cannot read: not UTF-8 (byte 3)\n"


def test_a_folder_that_is_called_as_a_document(folder: Path) -> None:
    """A folder named like a document is ignored."""
    (folder / "x.md").mkdir()
    run_tool("docs.making.__main__")
