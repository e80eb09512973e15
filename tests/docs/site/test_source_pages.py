"""The page of a source file: every line once, what its docstring says on the left, links to what belongs to it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.making.site import folders, highlighting, sources
from docs.making.site.check import read
from docs.making.site.published import CODE, ROOT, published
from docs.making.site.sources import Source


def source(path: str, root: Path = ROOT) -> Source:
    """A file of the project."""
    return Source(path, (root / path).read_text(encoding="utf-8"))


def test_every_line_has_one_anchor() -> None:
    """Of the docstring, of the code and the blank ones between: of the hand, in Python and as text."""
    site = published(ROOT, ("layers/hand", "prototxt/hand"))
    for path in (path for path in site.sources if path.startswith(("layers/hand/", "prototxt/hand/"))):
        one = source(path)
        html = sources.page(one, site).replace(sources.CODE, sources.code(one, site))
        found = re.findall(r'id="(L\d+)"', html)
        assert sorted(found) == sorted(sources.anchors(one)), path
        assert len(found) == one.text.count("\n"), path


def test_the_docstring_is_on_the_left_and_not_on_the_right(project: Path) -> None:
    """Sentences flow, a formula keeps its columns, what HTML means is written out."""
    site = published(project, ("layers", "fast"))
    one = source("layers/relu.py", project)
    page, code = sources.page(one, site), sources.code(one, site)
    assert '<p><span id="L1">ReLU: cut off | what is &lt; 0.\n</span><span id="L2"></span></p>' in page
    assert '<pre><span id="L3">y  = max(x, 0)\n</span><span id="L4"></span><span id="L5"></span></pre>' in page
    assert "max" not in code and code.count("\n") == 9
    assert 'id="L6"><a href="#L6" data-n="6" tabindex="-1"></a>' in code


def test_what_belongs_to_it(project: Path) -> None:
    """Its names, tests, twin, the documents that tell of it, the files that it names, the modules that it imports."""
    site = published(project, ("layers", "fast"))
    one, other = source("layers/relu.py", project), source("layers/scale.py", project)
    assert read(sources.page(one, site)).to == [
        "index.html", "#L9", "#L10", "../tests/layers/test_relu.py.html", "../fast/relu.py.html", "../index.html",
        "../docs/net.html",
    ]  # fmt: skip
    assert '<span class="nn"><a href="scale.py.html">layers.scale</a></span>' in sources.code(one, site)
    assert read(sources.page(other, site)).to[1:3] == ["relu.py.html", "relu.py.html"]
    assert "Plain" in sources.page(source("fast/relu.py", project), site)


@pytest.mark.parametrize(
    "lines, flows",
    [
        (["A sentence."], True),
        (["y = x w + b"], False),
        (["y = x w + b."], False),
        (["bottom[0]  x     (N, C)"], False),
        (["    indented, as an example:"], False),
        (["a " * 50 + "b", "and the rest of it"], True),
        (["one line", "and one more, both short."], False),
    ],
)
def test_what_flows(lines: list[str], flows: bool) -> None:
    """Only what no column or line end of is meant."""
    assert sources._flows(lines, alone=False) is flows


def test_prototxt_has_colours() -> None:
    """Names of fields, strings, numbers, constants, comments; and not a letter is lost."""
    text = 'layer { type: "ReLU"  lr_mult: -1.5e-3 phase: TRAIN }  # "why"\n'
    pieces = [(kind, piece) for kind, piece in highlighting.pieces(text, "x.prototxt") if kind and kind != "p"]
    assert pieces == [
        ("nt", "layer"), ("nt", "type"), ("s2", '"ReLU"'), ("nt", "lr_mult"), ("mf", "-1.5e-3"), ("nt", "phase"),
        ("kc", "TRAIN"), ("c1", '# "why"'),
    ]  # fmt: skip
    assert "".join(piece for _, piece in highlighting.pieces(text, "x.prototxt")) == text


def test_the_comment_at_the_head_of_a_prototxt_is_its_docstring() -> None:
    """It says what the file is."""
    assert source("prototxt/hand/nyu.prototxt").first_line().startswith("The NYU hand")


def test_the_page_of_a_folder(project: Path) -> None:
    """Its own files first, then each room with what it says of itself; marks of Markdown are none here."""
    site = published(project, ("layers", "fast"))
    page = folders.page("layers", site, lambda path: source(path, project))
    assert "The layers, `all`. ([\\_\\_init\\_\\_.py](__init__.py))" in page
    assert "| [relu.py](relu.py) | ReLU: cut off \\| what is &lt; 0. |" in page
    assert page.index("scale.py") < page.index("## data\n\nRooms for data.") < page.index("[labels.py](data/labels.py)")


def test_the_folders_of_code_are_there() -> None:
    """A folder that is renamed would be missing without a word. Without fast/ every chapter but one is complete."""
    assert [folder for folder in CODE if not (ROOT / folder).is_dir()] in ([], ["fast"], ["docs/exercises"])
