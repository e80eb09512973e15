"""Documents: every link between files of this project has a target, and the commands named in them exist."""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

import handpose
from docs.making import markdown, symbols
from layers import LAYER_TYPES
from netlib import caffe, engine
from netlib.caffe import pycaffe

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(path for top in ("docs", "models", "tests") for path in ROOT.glob(f"{top}/**/*.md"))]
)
TOOL = re.compile(r"(?<!tests/)\b(tools/\w+\.py)\b")


def fault_of(link: markdown.Link, document: Path) -> str:
    """Return the fault of a link: its file, its heading, or the line of the name in its title; empty if none."""
    target, _, anchor = link.target.partition("#")
    file = (document.parent / unquote(target)).resolve() if target else document
    if not file.exists():
        return "there is no such file"
    if re.fullmatch(r"L\d+", anchor):
        if file.suffix not in symbols.SUFFIXES or not link.title:
            return "a link to a line has a title, which names what stands there"
        return "" if symbols.line_of(file, link.title) == int(anchor[1:]) else "run make docs"
    anchors = map(markdown.anchor_of, markdown.headings(file.read_text(encoding="utf-8"))) if anchor else ()
    return "" if not anchor or anchor in anchors else "there is no such heading"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    """A link leads to an existing file, to a heading of it, or to the line that defines the name in its title."""
    for link in markdown.links(path.read_text(encoding="utf-8")):
        if ROOT / "fast" in (path.parent / link.target).resolve().parents and not engine.has_fast():
            continue  # the folder may be deleted; the chapter on speed then has links to missing files
        assert not fault_of(link, path), f'{link.target} "{link.title}": {fault_of(link, path)}'


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ('[a](box.py#L2 "Box") [b](box.py) [c](#a-box) [d](../page.md#a-box) [e](..)', ""),
        ("[a](bag.py)", "there is no such file"),
        ("[a](#bag)", "there is no such heading"),
        ("[a](#in-code)", "there is no such heading"),
        ("[a](box.py#L2)", "a link to a line has a title"),
        ('[a](box.py#L1 "Box")', "run make docs"),
    ],
)
def test_a_link_that_leads_nowhere(tmp_path: Path, text: str, fault: str) -> None:
    """A link without a target is found, and its fault is named."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs/box.py").write_text("A = 1\nclass Box: ...\n")
    for page in (tmp_path / "page.md", tmp_path / "docs/page.md"):
        page.write_text("# A `box`\n```text\n# in code\n```\n")
    faults = [fault_of(link, tmp_path / "docs/page.md") for link in markdown.links(text)]
    assert faults and all(found.startswith(fault) and bool(found) == bool(fault) for found in faults)


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_tools_that_are_named_are_there(path: Path) -> None:
    """Every tool named in a document exists; the changelog names removed ones."""
    for tool in [] if path.name == "CHANGELOG.md" else TOOL.findall(path.read_text(encoding="utf-8")):
        assert (ROOT / tool).is_file(), tool


def test_every_layer_type_is_told() -> None:
    """Every layer type is in the document on Caffe and, except the old DeepHandModel names, in that on layers."""
    layers, caffe = ((ROOT / f"docs/{name}.md").read_text(encoding="utf-8") for name in ("layers", "caffe"))
    for name in LAYER_TYPES:
        assert re.search(rf"\b{name}\b", caffe), name
        assert name.startswith("DeepHandModel") or re.search(rf"\b{name}\b", layers), name


def test_all_of_pycaffe_is_told() -> None:
    """Every name of the module and every public name of its Net and solvers is in the document on Caffe."""
    text = (ROOT / "docs/caffe.md").read_text(encoding="utf-8")
    names = {*caffe.__all__, *(n for cls in (pycaffe.Net, pycaffe.Solver) for n in vars(cls) if not n.startswith("_"))}
    ours = {"Solver", "TRAIN", "TEST", "net_class", "update_rule", "solver_count", "solver_rank", "set_multiprocess"}
    assert {name for name in names - ours if not re.search(rf"\b{name}\b", text)} == set()


def test_the_changelog_has_the_version() -> None:
    """The changelog's first release is the version in handpose/__init__.py, which setup.cfg reads."""
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    releases = [heading for heading in headings if heading != "Unreleased"]
    assert re.fullmatch(rf"{re.escape(handpose.__version__)} \(\d{{4}}-\d\d-\d\d\)", releases[0])
