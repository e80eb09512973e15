"""docs/making/notebooks.py: the chapters as notebooks, all of them executed."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

import pytest

import netlib
from docs.making import notebooks
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
    """Sessions become code cells without prompts and outputs; blocks that are not run stay text."""
    assert list(cells(DOCUMENT)) == [
        ("markdown", "# Title\n\n<!-- not run: it takes hours -->\n```python\nnever()\n```"),
        ("code", "for i in range(2):\n    print(i)\nx = 1"),
        ("raises-exception", "1 / 0"),
        ("markdown", "The end."),
    ]


CHAPTERS = sorted(path.stem for path in (ROOT / "docs" / "book").glob("[0-9]*.md"))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the written notebooks."""
    folder = tmp_path_factory.mktemp("notebooks")
    (folder / "docs").symlink_to(ROOT / "docs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(notebooks, "ROOT", folder)
        patch.setattr(notebooks, "PLACE", folder / "build")
        assert main() == 0
    return folder / "build"


def test_every_chapter_is_written(written: Path) -> None:
    """Each chapter becomes a notebook in a format that Jupyter reads, which starts in the project's folder."""
    assert sorted(path.stem for path in written.glob("*.ipynb")) == CHAPTERS
    for path in written.glob("*.ipynb"):
        made = json.loads(path.read_text(encoding="utf-8"))
        assert made["nbformat"] == 4 and made["cells"][0]["source"][1].startswith("os.chdir(")


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_every_chapter_runs(chapter: str, written: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
