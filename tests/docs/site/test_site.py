"""The site: made as ``make site`` makes it; strictly, so that a link that leads nowhere fails."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from netlib import engine
from netlib.files.paths import ROOT
from tests.support.running import run_python

pytest.importorskip("mkdocs", reason="the site needs: pip install -e '.[docs]'")
pytest.importorskip("material", reason="the site needs: pip install -e '.[docs]'")
# Pages of all documents, of what they link to, and of these; those of the rest are made alike, and take the longest.
CODE = ["layers/hand", "layers/common", "prototxt", "docs/exercises"]


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
    """The site needs no network. That every link leads somewhere is checked by MkDocs while it makes the site."""
    pages = [path for path in site.rglob("*.html") if path.name != "404.html"]
    assert len(pages) > 60
    for page in pages:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r'\bsrc="?(https?:)?//|<link[^>]+href="?(https?:)?//', text), page


def test_documents_and_code_have_pages(site: Path) -> None:
    """At their own places; a layer with its first line, its tests and its code; what is no document is not there."""
    names = ("index", "CHANGELOG", "docs/layers", "docs/book/index", "layers/hand/index", "prototxt/hand/nyu.prototxt")
    assert [name for name in names if not (site / f"{name}.html").is_file()] == []
    page = (site / "layers/hand/kinematics.py.html").read_text(encoding="utf-8")
    assert page.index("test_kinematics.py") < page.index('id="L1"') < page.index('<span class="nc">Kinematics</span>')
    assert not list(site.glob("docs/making/**/*"))


def test_lists_tables_and_prototxt_are_such(site: Path) -> None:
    """The reading order of the source, the table of layers, a list in a list, a net in its colours."""
    assert "<ol>" in (site / "docs/code.html").read_text(encoding="utf-8")
    assert "<td>vision</td>" in (site / "docs/layers.html").read_text(encoding="utf-8")
    assert "<ul>\n<li><code>case</code>" in (site / "tests/caffe/index.html").read_text(encoding="utf-8")
    assert '<span class="nt">dof</span>' in (site / "docs/book/8_hand.html").read_text(encoding="utf-8")


def test_pages_are_embedded_in_their_chapters(site: Path) -> None:
    """A comment on GitHub, a frame on the site, and the page is where the frame looks for it."""
    text = (site / "docs/book/9_gradient.html").read_text(encoding="utf-8")
    found = re.search(r'<iframe src="(.+?)" title="A force on the wrist" height="900" loading="lazy"></iframe>', text)
    assert found and found[1] == "../hand.html#body=arm&amp;shoulder=53.13&amp;elbow=36.87&amp;force=wrist,1,2,0"
    assert (site / "docs/hand.html").is_file()


def test_formulas_are_set_without_a_network(site: Path) -> None:
    """KaTeX, its fonts and the script that calls it are in the site; every formula is an element of its own."""
    page = (site / "docs/book/6_descent.html").read_text(encoding="utf-8")
    assert page.count('<div class="arithmatex">') >= 8 and "$$" not in page
    assert "../../assets/katex/katex.min.js" in page and "../../assets/math.js" in page
    style = (site / "assets/katex/katex.min.css").read_text(encoding="utf-8")
    fonts = set(re.findall(r"url\((fonts/[^)]+\.woff2)\)", style))
    assert fonts and all((site / "assets/katex" / font).is_file() for font in fonts)


def test_the_search_works_from_the_disk(site: Path) -> None:
    """Its index is a script, and has the first line of each file; it has no code in it."""
    text = (site / "search/search_index.js").read_text(encoding="utf-8").removeprefix("var __index = ")
    told = {entry["location"]: entry["text"] for entry in json.loads(text)["docs"]}
    assert "torques" in told["layers/hand/kinematics.py.html"]
    assert "np.zeros" not in told["layers/hand/kinematics.py.html"]
    assert "iframe-worker.js" in (site / "index.html").read_text(encoding="utf-8")
