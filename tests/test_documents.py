"""Documents: every link between files of this project leads somewhere, and the commands named are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from layers import LAYER_TYPES
from netlib import caffe, engine
from netlib.caffe import pycaffe

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/**/*.md")])
LINK = re.compile(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)")
TOOL = re.compile(r"\b((?:tools|benchmarks)/\w+\.py)\b")


def anchors(path: Path) -> set[str]:
    """The anchors that GitHub makes of a document's headings."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    """To a file that is there, and to a heading of it."""
    for target, anchor in LINK.findall(path.read_text(encoding="utf-8")):
        file = (path.parent / target).resolve() if target else path
        if ROOT / "fast" in file.parents and not engine.has_fast():
            continue  # the folder may be deleted; the chapter on speed then speaks of what is gone
        assert file.exists(), target
        assert not anchor or anchor in anchors(file), f"{target}#{anchor}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_tools_that_are_named_are_there(path: Path) -> None:
    """A document must not speak of a command that is gone."""
    for tool in TOOL.findall(path.read_text(encoding="utf-8")):
        assert (ROOT / tool).is_file(), tool


def test_every_layer_type_is_told() -> None:
    """In the chapter on layers by its folder, in the one on Caffe by what is the same and what is not."""
    layers, caffe = ((ROOT / f"docs/{name}.md").read_text(encoding="utf-8") for name in ("layers", "caffe"))
    for name in LAYER_TYPES:
        assert re.search(rf"\b{name}\b", caffe), name
        assert name.startswith("DeepHandModel") or re.search(rf"\b{name}\b", layers), name


def test_all_of_pycaffe_is_told() -> None:
    """Every name of the module, every public name of its Net and solvers."""
    text = (ROOT / "docs/caffe.md").read_text(encoding="utf-8")
    names = {*caffe.__all__, *(n for cls in (pycaffe.Net, pycaffe.Solver) for n in vars(cls) if not n.startswith("_"))}
    ours = {"Solver", "TRAIN", "TEST", "net_class", "update_rule", "solver_count", "solver_rank", "set_multiprocess"}
    assert {name for name in names - ours if not re.search(rf"\b{name}\b", text)} == set()
