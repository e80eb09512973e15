"""The site as ``make site`` builds it, in strict mode, so that broken links are errors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from netlib import engine
from netlib.files.paths import ROOT
from tests.support.chromium_tabs import browser
from tests.support.running import run_python

__all__ = ["browser"]

pytest.importorskip("mkdocs", reason="the site needs: pip install -e '.[docs]'")
pytest.importorskip("material", reason="the site needs: pip install -e '.[docs]'")
# Pages of all documents, the files they link to, and these folders; other pages are made alike and take the longest.
CODE = ["layers/hand", "prototxt/hand"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The finished site, with fewer pages of code."""
    if not engine.has_fast():
        pytest.skip("documents speak of fast/, which is not there")
    folder = tmp_path_factory.mktemp("made")
    config = folder / "mkdocs.yml"
    hook = ROOT / "docs/making/site/hook.py"
    config.write_text(
        f"INHERIT: {json.dumps(str(ROOT / 'mkdocs.yml'))}\ndocs_dir: {json.dumps(str(ROOT / 'docs'))}\nwatch: []\n"
        f"hooks: [{json.dumps(str(hook))}]\nextra: {{code: {json.dumps(CODE)}}}\n"
        "validation: {nav: {not_found: info}}\n",
        encoding="utf-8",
    )
    command = ["-m", "mkdocs", "build", "--strict", "-f", config, "-d", folder / "site"]
    run_python(*command, cwd=folder, NO_MKDOCS_2_WARNING="1")
    return folder / "site"


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    """No page loads anything from a network. MkDocs checks all links while it builds the site."""
    pages = [path for path in site.rglob("*.html") if path.name != "404.html"]
    assert len(pages) > 60
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'\bsrc="?(https?:)?//|<link[^>]+href="?(https?:)?//', text), page


def test_documents_and_code_have_pages(site: Path) -> None:
    """Documents and code have pages; that of a layer has its tests and its code; docs/making has none."""
    names = ("index", "CHANGELOG", "docs/layers", "docs/book/index", "layers/hand/index", "prototxt/hand/nyu.prototxt")
    assert [name for name in names if not (site / f"{name}.html").is_file()] == []
    page = (site / "layers/hand/kinematics.py.html").read_text(encoding="utf-8")
    assert page.index("test_kinematics.py") < page.index('id="L1"') < page.index('<span class="nc">Kinematics</span>')
    assert not list(site.glob("docs/making/**/*"))


def test_lists_tables_and_prototxt_are_such(site: Path) -> None:
    """Lists, tables, nested lists and prototxt with highlighting are rendered as such."""
    assert "<ol>" in (site / "docs/code.html").read_text(encoding="utf-8")
    assert "<td>vision</td>" in (site / "docs/layers.html").read_text(encoding="utf-8")
    assert "<ul>\n<li><code>case</code>" in (site / "tests/caffe/index.html").read_text(encoding="utf-8")
    assert '<span class="nt">dof</span>' in (site / "docs/book/8_hand.html").read_text(encoding="utf-8")


def test_pages_are_embedded_in_their_chapters(site: Path) -> None:
    """A comment, invisible on GitHub, becomes an iframe on the site, and the page it shows exists."""
    text = (site / "docs/book/9_gradient.html").read_text(encoding="utf-8")
    found = re.search(r'<iframe src="(.+?)" title="A force on the wrist" height="900" loading="lazy"></iframe>', text)
    assert found and found[1] == "../hand.html#body=arm&amp;shoulder=53.13&amp;elbow=36.87&amp;force=wrist,1,2,0"
    assert (site / "docs/hand.html").is_file()


@pytest.fixture(scope="module")
def phone(browser: Any) -> Iterator[Any]:
    """A tab of a phone's size, for one page after the other."""
    tab = browser.new_page(viewport={"width": 400, "height": 800})
    yield tab
    tab.close()


@pytest.mark.parametrize("name", ["3_convolution", "5_net", "9_gradient"])
def test_an_embedded_page_does_not_scroll(site: Path, phone: Any, name: str) -> None:
    """On a phone an iframe is as high as the page in it, when the page has been laid out and when it has changed."""
    phone.goto((site / f"docs/book/{name}.html").as_uri())
    phone.locator("iframe[height]").scroll_into_view_if_needed()
    fits = "() => document.body && document.documentElement.scrollHeight <= document.documentElement.clientHeight"
    for change in ("", "document.body.append(Object.assign(document.createElement('p'), {style: 'height: 300px'}))"):
        inner = phone.locator("iframe[height]").element_handle().content_frame()
        inner.wait_for_selector("main")
        inner.evaluate(change)
        inner.wait_for_function(fits)


def test_figures_can_be_enlarged(site: Path) -> None:
    """A figure is a link to its file, which a browser shows alone and enlarges; icons in a line of text are not."""
    text = (site / "docs/book/6_descent.html").read_text(encoding="utf-8")
    assert re.search(r'<a href="../images/book/valley.svg"><img [^>]*src="../images/book/valley.svg"', text)
    assert (site / "docs/images/book/valley.svg").is_file()


def test_formulas_are_set_without_a_network(site: Path) -> None:
    """KaTeX, its fonts and the script that calls it are part of the site; every formula is in its own element."""
    page = (site / "docs/book/6_descent.html").read_text(encoding="utf-8")
    assert page.count('<div class="arithmatex">') >= 8 and "$$" not in page
    assert "../../assets/katex/katex.min.js" in page and "../../assets/math.js" in page
    style = (site / "assets/katex/katex.min.css").read_text(encoding="utf-8")
    fonts = set(re.findall(r"url\((fonts/[^)]+\.woff2)\)", style))
    assert fonts and all((site / "assets/katex" / font).is_file() for font in fonts)


def test_the_search_works_from_the_disk(site: Path) -> None:
    """The search index is a script with the first line of each file, but without code."""
    text = (site / "search/search_index.js").read_text(encoding="utf-8").removeprefix("var __index = ")
    texts = {entry["location"]: entry["text"] for entry in json.loads(text)["docs"]}
    assert "torques" in texts["layers/hand/kinematics.py.html"]
    assert "np.zeros" not in texts["layers/hand/kinematics.py.html"]
    assert "iframe-worker.js" in (site / "index.html").read_text(encoding="utf-8")


def test_code_scrolls_on_a_narrow_screen(site: Path, phone: Any) -> None:
    """No page is wider than a phone, even with long lines of prototxt, Python sessions, tables or source files."""
    for name in ("index", "docs/book/1_blob", "docs/book/8_hand", "docs/fit"):
        phone.goto((site / f"{name}.html").as_uri())
        root = "document.documentElement"
        assert phone.evaluate(f"{root}.scrollWidth - {root}.clientWidth") == 0, name


def test_the_copy_button_takes_the_code_of_a_session(site: Path, phone: Any) -> None:
    """The copy button copies a session without prompts and output; the theme sets the attribute while it copies."""
    phone.goto((site / "docs/book/1_blob.html").as_uri())
    copied = phone.evaluate("""() => {
        const code = [...document.querySelectorAll(".highlight code")].find(code => code.querySelector(".gp"));
        code.setAttribute("data-md-copying", "");
        return code.innerText;
    }""")
    assert copied.startswith("x, w, t = 2.0, 3.0, 5.0\na = w * x\n") and copied.rstrip().endswith("L, dw, dx")
