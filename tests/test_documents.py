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
LINK = re.compile(r'\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?(?: "([^"]*)")?\)')
TOOL = re.compile(r"(?<!tests/)\b((?:tools|benchmarks)/\w+\.py)\b")


def anchors(path: Path) -> set[str]:
    """The anchors that GitHub makes of a document's headings."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    """To a file that is there, and to a heading of it, or to the line on which the name in the link's title stands."""
    for target, anchor, title in LINK.findall(path.read_text(encoding="utf-8")):
        file = (path.parent / target).resolve() if target else path
        if ROOT / "fast" in file.parents and not engine.has_fast():
            continue  # the folder may be deleted; the chapter on speed then speaks of what is gone
        assert file.exists(), target
        if re.fullmatch(r"L\d+", anchor):
            assert is_at(file, int(anchor[1:]), title), f'{target}#{anchor} "{title}": run make docs'
        else:
            assert not anchor or anchor in anchors(file), f"{target}#{anchor}"


def is_at(file: Path, number: int, title: str) -> bool:
    """Whether the line of a file makes this name: a test by ``def``, all else as its language does."""
    lines = file.read_text(encoding="utf-8").splitlines()
    if not title or number > len(lines):
        return False
    line, name = lines[number - 1], re.escape(title.split(".")[-1])
    if file.suffix == ".prototxt":  # a field, or a message whose name stands beside its brace or below it
        field = re.match(rf"\s*{name}\s*[:{{]", line)
        return bool(field or re.match(rf'\s*\w+ {{\s*(?:#.*)?name: "{name}"', " ".join(lines[number - 1 : number + 1])))
    if re.match(r"test_", name):
        return re.match(rf"def {name}\(", line) is not None
    return re.match(rf"\s*(?:(?:def|class) {name}\b|{name}\s*[:=])", line) is not None


@pytest.mark.parametrize(
    ("number", "title", "there"),
    [
        (1, "test_a", True),
        (1, "test", False),
        (1, "", False),
        (2, "test_a", False),
        (3, "Box.side", True),
        (3, "Box", False),
        (9, "Box", False),
    ],
)
def test_a_line_is_checked(tmp_path: Path, number: int, title: str, there: bool) -> None:
    """A wrong line, a line after the end, and a line without a name are found."""
    file = tmp_path / "box.py"
    file.write_text("def test_a() -> None:\n    class Box:\n        side = 1  # test_a Box\n")
    assert is_at(file, number, title) is there


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
