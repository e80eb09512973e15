"""Documents: links lead to files, headings and names that exist, and the reference
pages are complete.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

import handpose
from layers import LAYER_TYPES
from netlib import caffe, engine
from netlib.caffe import pycaffe
from netlib.files.paths import ROOT
from tests.support.running import run_python

PACKAGES = ("netlib", "layers", "fast", "handpose", "export")
PLACES = ("*.md", "docs/**/*.md", "models/**/*.md", "tests/**/*.md")
DOCUMENTS = sorted(path for place in PLACES for path in ROOT.glob(place))
CODE = re.compile(r"^ *(`{3,}).*?^ *\1|(?<!`)(`+)(?!`).+?(?<!`)\2(?!`)", re.MULTILINE | re.DOTALL)
LINK = re.compile(r'\]\(<?(?![a-z]+:)([^)\s>#]*)#?([^)\s>]*)>?(?:\s+"([^"]*)")?\)')


def faults(text: str, document: Path) -> list[str]:
    """The links of a document to a file, a heading or a name that does not exist."""
    found = []
    for target, anchor, title in LINK.findall(CODE.sub("`code`", text)):
        file = (document.parent / unquote(target)).resolve() if target else document
        if ROOT / "fast" in file.parents and not engine.has_fast():
            continue
        if not file.exists():
            found.append(f"{target}: there is no such file")
        elif anchor and anchor not in anchors(file.read_text(encoding="utf-8")):
            found.append(f"{target}#{anchor}: there is no such heading")
        elif re.fullmatch(r"[\w.]+", title) and not re.search(
            rf"\b{title.rpartition('.')[2]}\b", file.read_text(encoding="utf-8")
        ):
            found.append(f"{target}: there is no {title}, which the title of a link names")
    return found


def anchors(text: str) -> list[str]:
    """The anchors of the headings."""
    outside = re.sub(r"^ *(`{3,}).*?^ *\1", "", text, flags=re.MULTILINE | re.DOTALL)
    return [anchor_of(heading) for heading in re.findall(r"^#+ +(.*?) *$", outside, re.MULTILINE)]


def anchor_of(heading: str) -> str:
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_link_targets_exist(path: Path) -> None:
    assert faults(path.read_text(encoding="utf-8"), path) == []


def test_every_layer_type_is_described() -> None:
    """Every layer type is in the document on Caffe and, except the old DeepHandModel names, in
    that on layers.
    """
    layers, of_caffe = (
        (ROOT / f"docs/{name}.md").read_text(encoding="utf-8") for name in ("layers", "caffe")
    )
    for name in LAYER_TYPES:
        assert re.search(rf"\b{name}\b", of_caffe), name
        assert name.startswith("DeepHandModel") or re.search(rf"\b{name}\b", layers), name


SET = re.compile(r'os\.environ(?:\.setdefault\("(\w+)"|\["(\w+)"\] *=(?!=))')


def test_environment_variables_set_by_the_code_are_documented() -> None:
    """A process gains no others by an import."""
    text = (ROOT / "docs" / "net.md").read_text(encoding="utf-8")
    described = set(re.findall(r"^\| `(\w+)`", text, re.MULTILINE))
    sources = [path for top in PACKAGES for path in (ROOT / top).rglob("*.py")]
    found = [SET.findall(path.read_text(encoding="utf-8")) for path in sources]
    names = {one or other for pairs in found for one, other in pairs}
    assert names <= described
    code = "import os; before = {*os.environ}; import handpose, netlib; netlib.engine.get(); "
    code += "print(*{*os.environ} - before)"
    gained = run_python("-c", code, **dict.fromkeys(described)).out.split()
    assert {"OPENCV_IO_MAX_IMAGE_PIXELS"} <= {*gained} <= names


def test_all_of_pycaffe_is_described() -> None:
    """Every name of the module and every public name of its Net and solvers is in the
    document on Caffe.
    """
    text = (ROOT / "docs/caffe.md").read_text(encoding="utf-8")
    members = {*vars(pycaffe.Net), *vars(pycaffe.Solver)}
    names = {*caffe.__all__, *(name for name in members if name[0] != "_")}
    ours = {
        "Solver",
        "TRAIN",
        "TEST",
        "net_class",
        "update_rule",
        "solver_count",
        "solver_rank",
        "set_multiprocess",
    }
    assert {name for name in names - ours if not re.search(rf"\b{name}\b", text)} == set()


def test_the_changelog_has_the_version() -> None:
    """The changelog's first release is the version in handpose/__init__.py, which
    setup.cfg reads.
    """
    headings = re.findall(
        r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    releases = [heading for heading in headings if heading != "Unreleased"]
    assert re.fullmatch(rf"{re.escape(handpose.__version__)} \(\d{{4}}-\d\d-\d\d\)", releases[0])
