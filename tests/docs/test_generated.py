"""What ``make docs`` makes: the generated parts of documents, the site, the notebooks
and the figures.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from netlib import engine
from netlib.files.paths import ROOT
from tests.support.chromium_tabs import browser
from tests.support.running import run_python, run_tool

__all__ = ["browser"]

MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
DOCUMENTS = sorted(str(path) for place in ("docs/*.md", "docs/*/*.md") for path in ROOT.glob(place))


def test_generated_parts_of_documents_are_current() -> None:
    """cog, with the options of the Makefile, would change no document."""
    pytest.importorskip(
        "cogapp", reason="cog generates parts of documents: pip install -e '.[test]'"
    )
    options = re.search(r"^COG := (.*)$", MAKEFILE, re.MULTILINE)[1]
    run_python("-m", "cogapp", "--check", *shlex.split(options), *DOCUMENTS)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built in strict mode."""
    pytest.importorskip("material", reason="the site needs: pip install -e '.[docs]'")
    if not engine.has_fast():
        pytest.skip("documents refer to fast/, which is not there")
    folder = tmp_path_factory.mktemp("made") / "site"
    run_python("-m", "mkdocs", "build", "--strict", "-d", folder, NO_MKDOCS_2_WARNING="1")
    return folder


def test_the_site_works_offline(site: Path) -> None:
    """Pages load nothing from a network; formulas, figures, the search and embedded pages are
    part of the site.
    """
    pages = [path for path in site.rglob("*.html") if path.name != "404.html"]
    assert len(pages) > 40
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'\bsrc="?(https?:)?//|<link[^>]+href="?(https?:)?//', text), page
    chapter = (site / "book/9_gradient.html").read_text(encoding="utf-8")
    assert chapter.count('<div class="arithmatex">') >= 4
    assert "$$" not in chapter
    assert '<a href="../images/book/lever.svg"><img' in chapter
    assert (site / "images/book/lever.svg").is_file()
    assert '<iframe src="../hand.html#body=arm&amp;' in chapter
    assert (site / "hand.html").is_file()
    for font in re.findall(
        r"url\((fonts/[^)]+\.woff2)\)", (site / "assets/katex/katex.min.css").read_text("utf-8")
    ):
        assert (site / "assets/katex" / font).is_file()
    assert "iframe-worker.js" in chapter
    assert (site / "search/search_index.js").is_file()


def test_pages_fit_a_phone(site: Path, browser: Any) -> None:
    """No page is wider than a phone, and an embedded page is as high as its content, so it
    does not scroll.
    """
    tab = browser.new_page(viewport={"width": 390, "height": 800})
    for name in ("index", "camera", "book/3_convolution"):
        tab.goto((site / f"{name}.html").as_uri())
        assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0, name
    tab.locator("iframe[height]").scroll_into_view_if_needed()
    inner = tab.locator("iframe[height]").element_handle().content_frame()
    inner.wait_for_function("document.body && document.documentElement.scrollHeight <= innerHeight")
    assert tab.locator(".katex").count()
    tab.close()


def test_a_notebook_has_the_code_of_its_chapter() -> None:
    """Sessions are cells without prompts, an error has Jupyter's tag, generated code stays text."""
    pytest.importorskip("jupytext", reason="notebooks need: pip install -e '.[docs]'")
    from docs.making.notebooks import notebook

    cells = json.loads(notebook(ROOT / "docs/book/1_blob.md"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    text = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert "os.chdir(project)" in code[0]
    assert code[1].startswith("x, w, t = 2.0, 3.0, 5.0\na = w * x\n")
    assert not any(">>>" in cell or "class Value" in cell for cell in code)
    assert "class Value" in text
    assert [cell["metadata"].get("tags") for cell in cells].count(["raises-exception"]) == 1
    assert "](2_one_layer.ipynb)" in text
    assert "](../images/book/circuit.svg)" in text


def test_a_figure_is_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``python -m docs.making.figures NAME`` writes one figure, with colours for dark pages."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("docs.making.figures.__main__.PLACE", tmp_path)
    run_tool("docs.making.figures.__main__ arm")
    assert "prefers-color-scheme: dark" in (tmp_path / "arm.svg").read_text(encoding="utf-8")


def test_the_training_of_chapter_0_reduces_its_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On two frames; it prints the errors and draws the picture."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("docs.making.five_minutes.BATCH", 8)
    monkeypatch.setattr("docs.making.five_minutes.HELD_OUT", 6)
    out = tmp_path / "hands.svg"
    done = run_tool("docs.making.five_minutes --frames 2 --iterations 10 --out", out)
    errors = [float(error) for error in re.findall(r"training frames +([\d.]+) mm", done.out)]
    assert len(errors) == 11
    assert errors[-1] < errors[0]
    assert out.is_file()
