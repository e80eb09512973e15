"""docs/making/notebooks.py: the chapters as notebooks, one of them executed."""

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
    """Sessions lose prompts and outputs; blocks that are not run stay text."""
    assert list(cells(DOCUMENT)) == [
        ("markdown", "# Title\n\n<!-- not run: it takes hours -->\n```python\nnever()\n```"),
        ("code", "for i in range(2):\n    print(i)\nx = 1"),
        ("raises-exception", "1 / 0"),
        ("markdown", "The end."),
    ]


def test_every_chapter_is_written_and_one_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All are notebooks with code; the cells of chapter 1 run from its first to its last."""
    monkeypatch.setattr(notebooks, "ROOT", tmp_path)
    monkeypatch.setattr(notebooks, "PLACE", tmp_path / "build")
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    assert main() == 0
    found = sorted((tmp_path / "build").glob("*.ipynb"))
    assert len(found) == len(list((ROOT / "docs" / "book").glob("[0-9]*.md")))
    for path in found:
        made = json.loads(path.read_text(encoding="utf-8"))
        assert made["nbformat"] == 4 and made["cells"][0]["source"][1].startswith("os.chdir(")
        if path.stem == "1_blob":
            monkeypatch.chdir(ROOT)
            space: dict[str, object] = {"__name__": "__main__"}
            code = [cell for cell in made["cells"] if cell["cell_type"] == "code"]
            assert len(code) > 5
            for cell in code[1:]:
                errors = (netlib.NetlibError, AssertionError)
                with pytest.raises(errors) if cell["metadata"] else contextlib.nullcontext():
                    exec(compile("".join(cell["source"]), path.name, "exec"), space)
