"""The page of a source file: its first line, links to related files, and an anchor for every line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.making.site import folders, sources
from docs.making.site.published import CODE, ROOT, published


def text_of(path: str, root: Path = ROOT) -> str:
    return (root / path).read_text(encoding="utf-8")


@pytest.mark.parametrize("path", ["layers/hand/kinematics.py", "prototxt/hand/nyu.prototxt", "Makefile", "LICENSE"])
def test_every_line_has_one_anchor(path: str) -> None:
    """Every line has exactly one anchor, named as on GitHub."""
    text = text_of(path)
    html = sources.code(path, text)
    count = text.rstrip("\n").count("\n") + 1
    assert re.findall(r'<a id="(L\d+)"', html) == [f"L{number}" for number in range(1, count + 1)]
    assert re.search(r'<a href="#L1"> *1</a>', html)


def test_what_belongs_to_it(project: Path) -> None:
    """The page has the file's first line, escaped, its tests, and the documents that link to it or show its code."""
    site = published(project, ("layers", "fast"))
    assert sources.page("layers/relu.py", text_of("layers/relu.py", project), site) == (
        "# layers/relu.py\n\nReLU: cut off \\| what is &lt; 0.\n\n"
        "Tests: [tests/layers/test\\_relu.py](../tests/layers/test_relu.py)\n\n"
        f"Described in: [Small](../README.md), [The net](../docs/net.md)\n\n{sources.CODE}\n"
    )
    assert "Described in: [Data]" in sources.page("layers/scale.py", text_of("layers/scale.py", project), site)


def test_prototxt_has_colours() -> None:
    """Field names, strings, numbers, constants and comments are highlighted, and no character is lost."""
    text = 'layer { type: "ReLU"  lr_mult: -1.5e-3 phase: TRAIN }  # "why"\n'
    tokens = list(sources.PrototxtLexer().get_tokens(text))
    assert [(str(kind), piece) for kind, piece in tokens if str(kind) not in ("Token.Text", "Token.Punctuation")] == [
        ("Token.Name.Tag", "layer"), ("Token.Name.Tag", "type"), ("Token.Literal.String.Double", '"ReLU"'),
        ("Token.Name.Tag", "lr_mult"), ("Token.Literal.Number.Float", "-1.5e-3"), ("Token.Name.Tag", "phase"),
        ("Token.Keyword.Constant", "TRAIN"), ("Token.Comment.Single", '# "why"'),
    ]
    assert "".join(piece for _, piece in tokens) == text


def test_the_comment_at_the_head_of_a_prototxt_is_its_first_line() -> None:
    """The first comment of a prototxt describes the file."""
    path = "prototxt/hand/nyu.prototxt"
    assert sources.first_line(path, text_of(path)).startswith("The NYU hand")


def test_the_page_of_a_folder(project: Path) -> None:
    """The page of a folder lists its own files first, then each subfolder with its description; Markdown is escaped."""
    site = published(project, ("layers", "fast"))
    page = folders.page("layers", site, lambda path: text_of(path, project))
    assert "The layers, `all`. ([\\_\\_init\\_\\_.py](__init__.py))" in page
    assert "| [relu.py](relu.py) | ReLU: cut off \\| what is &lt; 0. |" in page
    assert page.index("scale.py") < page.index("## data\n\nRooms for data.") < page.index("[labels.py](data/labels.py)")


def test_the_folders_of_code_are_there() -> None:
    """All code folders exist, since a renamed one would silently be missing; fast/ may be absent."""
    assert [folder for folder in CODE if not (ROOT / folder).is_dir()] in ([], ["fast"])
