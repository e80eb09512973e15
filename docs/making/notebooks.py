"""The chapters of the book as notebooks, docs/book/*.ipynb, where their links and pictures are
those of the chapters.

``python`` and ``pycon`` blocks become code cells, without prompts and output. Blocks of other
kinds, code that is shown from a file and blocks that are not run stay text. A statement that raises
an error has its own cell, with Jupyter's tag ``raises-exception``, so that the cells after it run.
"""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import jupytext

from netlib.files.paths import ROOT

FIRST_CELL = """```python
# Run this cell first: the code of the chapter runs in the project's folder.
import os, sys
from pathlib import Path
project = next(str(folder) for folder in (Path.cwd(), *Path.cwd().parents) if (folder / "docs" / "book").is_dir())
os.chdir(project)
sys.path.insert(0, project)
```
"""
# Blocks that stay text: Python after a comment, which is group 1, and bash.
NOT_RUN = re.compile(r"(<!--(?:cog|not run)(?:(?!-->).)*-->\n+)```python\n|```bash\n", re.DOTALL)
SESSION = re.compile(r"^```pycon\n(.*?)^```\n", re.MULTILINE | re.DOTALL)


def notebook(chapter: Path) -> str:
    """The JSON text of a chapter's notebook."""
    text = chapter.read_text(encoding="utf-8")
    text = NOT_RUN.sub(lambda block: f"{block[1]}```py\n" if block[1] else "```console\n", text)
    text = re.sub(r"\]\((\d+_\w+)\.md", r"](\1.ipynb", text)  # links to other chapters
    text = SESSION.sub(_cells, text)
    title, heading, rest = text.partition("\n## ")
    cells = jupytext.reads(f"{title}\n{FIRST_CELL}{heading}{rest}", fmt="md")
    cells.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    return str(jupytext.writes(cells, fmt="ipynb"))


def _cells(session: re.Match[str]) -> str:
    """The statements of a session; each that prints something ends a cell, each that raises
    an error is one.
    """
    cells = [("", "")]  # options and source
    for example in doctest.DocTestParser().get_examples(session[1]):
        if example.exc_msg is not None:
            cells += [(' tags=["raises-exception"]', example.source), ("", "")]
            continue
        _, source = cells.pop()
        cells.append(("", source + example.source))
        if example.want:
            cells.append(("", ""))
    return "\n".join(f"```python{options}\n{source}```\n" for options, source in cells if source)


if __name__ == "__main__":
    for path in sorted((ROOT / "docs" / "book").glob("[0-9]*.md")):
        path.with_suffix(".ipynb").write_text(notebook(path), encoding="utf-8")
