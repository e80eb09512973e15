"""The checker of a finished site finds what leads nowhere, and only that."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from docs.making.site.check import faults
from netlib.files.paths import ROOT
from tests.support.running import run_tool

GOOD = '<h1 id="a b">x</h1><a name="old"></a><a href="sub/b.html#c">b</a><a href="#a%20b">a</a><a href="#old">o</a>'


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Two pages and a picture."""
    (tmp_path / "sub").mkdir()
    (tmp_path / "x.png").write_bytes(b"")
    (tmp_path / "index.html").write_text(GOOD + '<a href="https://elsewhere.org/x">', encoding="utf-8")
    (tmp_path / "sub/b.html").write_text(
        '<p id="c"><img src="../x.png"><a href="../index.html"></a><img src="data:image/png;base64,xx"></p>',
        encoding="utf-8",
    )
    return tmp_path


def test_a_good_site(site: Path) -> None:
    """Has no fault."""
    assert run_tool("docs.making.site.check", site).out == "every link leads somewhere\n"


@pytest.mark.parametrize(
    "html, fault",
    [
        ('<a href="c.html">', "sub/b.html links to c.html: there is no sub/c.html"),
        ('<a href="..">', "sub/b.html links to ..: there is no ."),
        ('<img src="y.png">', "sub/b.html links to y.png: there is no sub/y.png"),
        ('<a href="../index.html#b">', "sub/b.html links to ../index.html#b: index.html has no #b"),
        ('<a href="#d">', "sub/b.html links to #d: sub/b.html has no #d"),
        ('<script src="https://x.org/y.js">', "sub/b.html loads https://x.org/y.js: it must not need the net"),
        ('<link href="//x.org/y.css">', "sub/b.html loads //x.org/y.css: it must not need the net"),
    ],
)
def test_a_link_that_leads_nowhere(site: Path, html: str, fault: str) -> None:
    """To a page, a folder, a picture, an anchor; or what would be loaded from elsewhere."""
    (site / "sub/b.html").write_text(f'<p id="c"></p>{html}', encoding="utf-8")
    assert list(faults(site)) == [fault]
    assert fault in run_tool("docs.making.site.check", site, status=1).err


def test_no_site(tmp_path: Path) -> None:
    """Is told in one line."""
    assert run_tool("docs.making.site.check", tmp_path, status=2).err.count("\n") == 1


def test_what_the_configuration_names_is_there() -> None:
    """The documents, the code that is watched, and the hooks; this needs no mkdocs."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    named = [name for found in re.findall(r"^(?:watch|hooks): \[(.*)\]$|^docs_dir: (.*)$", text, re.MULTILINE)
             for part in found if part for name in part.split(", ")]  # fmt: skip
    assert {"README.md", "docs", "docs/making/site/hook.py"} <= set(named)
    assert [name for name in named if not (ROOT / name).exists()] == []
