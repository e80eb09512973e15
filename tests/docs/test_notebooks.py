"""docs/making/notebooks.py: the chapters as notebooks, all of them executed."""

from __future__ import annotations

import contextlib
import json
import re
import sys
from pathlib import Path

import pytest

import netlib
from docs.making import notebooks
from docs.making.markdown import links
from docs.making.notebooks import cells, main
from netlib.files.paths import ROOT

DOCUMENT = """# Title

<!-- not run: it takes hours -->
```python
never()
```

```pycon
>>> for i in range(2):
...     print(i)
0
1
>>> x = 1
>>> 1 / 0
Traceback (most recent call last):
ZeroDivisionError: division by zero
```

The end.
"""


def test_cells() -> None:
    """Sessions become code cells without prompts, one for each output; blocks that are not run stay text."""
    assert list(cells(DOCUMENT)) == [
        ("markdown", "# Title\n\n<!-- not run: it takes hours -->\n```python\nnever()\n```", ""),
        ("code", "for i in range(2):\n    print(i)", "0\n1\n"),
        ("code", "x = 1", ""),
        ("raises-exception", "1 / 0", "ZeroDivisionError: division by zero\n"),
        ("markdown", "The end.", ""),
    ]


CHAPTERS = sorted(path.stem for path in (ROOT / "docs" / "book").glob("[0-9]*.md"))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the written notebooks."""
    folder = tmp_path_factory.mktemp("notebooks")
    for path in ROOT.iterdir():
        if path.name != "build":
            (folder / path.name).symlink_to(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(notebooks, "ROOT", folder)
        patch.setattr(notebooks, "PLACE", folder / "build" / "book")
        patch.setattr(notebooks, "PICTURES", folder / "build" / "book" / "images")
        assert main() == 0
    return folder / "build" / "book"


def test_every_chapter_is_written(written: Path) -> None:
    """Each chapter becomes a notebook in a format that Jupyter reads, without a path of the machine."""
    assert sorted(path.stem for path in written.glob("*.ipynb")) == CHAPTERS
    for path in written.glob("*.ipynb"):
        text = path.read_text(encoding="utf-8")
        assert json.loads(text)["nbformat"] == 4 and str(ROOT) not in text and str(written) not in text


def test_every_link_and_picture_of_a_notebook_leads_somewhere(written: Path) -> None:
    """Links lead to files, notebooks and anchors that every viewer supports; pictures are copied next to notebooks."""
    texts = {path.name: "\n".join(markdown_of(path)) for path in written.glob("*.ipynb")}
    pictures = 0
    for name, text in texts.items():
        for link in links(text):
            target, _, anchor = link.target.partition("#")
            assert not target or (written / target).is_file(), f"{name}: {link.target}"
            pictures += target.startswith("images/")
            assert not target.endswith(".svg") or target.startswith("images/"), f"{name}: Jupyter cannot serve {target}"
            if anchor and (not target or target.endswith(".ipynb")):
                assert f'<a id="{anchor}"></a>\n\n#' in texts[target or name], f"{name}: {link.target}"
        assert not re.search(r"\]\([0-9]\w+\.md", text)
    assert pictures > 20


def test_cells_show_the_output_of_the_chapter(written: Path) -> None:
    """A cell has the printed text of its chapter as its output, one that raises an error has that error."""
    found = json.loads((written / "1_blob.ipynb").read_text(encoding="utf-8"))["cells"]
    code = {"".join(cell["source"]).splitlines()[-1]: cell["outputs"] for cell in found if cell["cell_type"] == "code"}
    assert code["L, dw, dx"] == [{"output_type": "stream", "name": "stdout", "text": ["(0.5, 2.0, 3.0)\n"]}]
    [raised] = [cell for cell in found if cell["metadata"]]
    [output] = raised["outputs"]
    assert output["output_type"] == "error" and output["ename"] == "netlib.gradcheck.GradientError"
    assert output["evalue"].startswith("ReLU: gradient of bottom 0 at (0, 1)")


def markdown_of(path: Path) -> list[str]:
    """Return the texts of a notebook's Markdown cells."""
    made = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in made["cells"] if cell["cell_type"] == "markdown"]


def test_the_first_cell_finds_the_project(written: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """From the notebook's folder the first cell enters the project's; elsewhere it raises an error of one line."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(written)
    for _ in range(2):
        exec(notebooks.FIRST, {})
        assert Path.cwd() == written.parents[1]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"keep it in build/book"):
        exec(notebooks.FIRST, {})


# tests/documents/test_blocks.py runs the blocks of all chapters, which are the cells.
@pytest.mark.parametrize("chapter", ["1_blob", "2_one_layer", "6_descent", "8_hand"])
def test_a_chapter_runs(chapter: str, written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All cells of a chapter run; those tagged so, and no others, raise an error."""
    monkeypatch.chdir(ROOT)
    space: dict[str, object] = {"__name__": "__main__"}
    cells = json.loads((written / f"{chapter}.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"][1:]
    assert len(code) > 3 or chapter.startswith("0_")
    for cell in code:
        errors = (netlib.NetlibError, AssertionError)
        with pytest.raises(errors) if cell["metadata"] else contextlib.nullcontext():
            exec(compile("".join(cell["source"]), chapter, "exec"), space)
