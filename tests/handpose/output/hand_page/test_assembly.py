"""handpose/output/hand_page/assembly.py"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path

import pytest

from handpose.output.drawing.hands import COLOURS
from handpose.output.hand_page import assembly
from handpose.output.hand_page.assembly import escaped, page, script_of


def test_the_page_is_one_file_that_names_no_other() -> None:
    """The page has no address, no link and no import; its data are one JSON text."""
    text = page("A & <B>", {"one": 1})
    assert "<title>A &amp; &lt;B&gt;</title>" in text and "<h1>A &amp; &lt;B&gt;</h1>" in text
    assert not re.search(r"https?:|<link|\bsrc=|url\(|@import|\bimport\s*[({\"']|\beval\(|innerHTML", text)
    assert re.search(r'<script type="application/json" id="data">\{"one":1\}</script>', text)
    assert not re.search(r"\$\w", text.split("<body>")[0])  # every placeholder of the template is filled


def test_only_its_own_script_and_style_may_run() -> None:
    """The policy contains the hashes of the script and of the style, computed as by the browser."""
    text = page("x", {})
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src 'none'; ") and "unsafe" not in policy
    for tag, rule in (('script type="module"', "script-src"), ("style", "style-src")):
        inside = re.search(rf"<{tag}>(.*?)</{tag.split()[0]}>", text, re.DOTALL)[1]
        assert f"{rule} 'sha256-{base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()}'" in policy


@pytest.mark.parametrize("evil", ["</script><script>", "<!--<script>", "]]>", "&lt;", "\u2028'\"\\", "\ud800"],
                         ids=["script", "comment", "CDATA", "entity", "quotes", "surrogate"])
def test_data_cannot_leave_their_place(evil: str) -> None:
    text = escaped({evil: [evil]})
    assert not set(text) & set("<>&") and text.isascii()
    assert json.loads(text) == {evil: [evil]}


def test_modules_stand_after_those_that_they_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each module occurs once, after its imports; other modules can import only its exports."""
    (tmp_path / "a.js").write_text(
        'import { b } from "./b.js";\nimport { c } from "./c.js";\nexport const a = b + c;\n'
    )
    (tmp_path / "b.js").write_text('import {\n  c,\n} from "./c.js";\nexport function b() {\n  return c;\n}\n')
    (tmp_path / "c.js").write_text("const own = 1;\nexport const c = own;\nexport class D {}\n")
    monkeypatch.setattr(assembly, "FOLDER", tmp_path)
    script = script_of("a")
    assert re.findall(r"^modules\.(\w) = ", script, re.MULTILINE) == ["c", "b", "a"]
    assert "return { D, c };" in script and "const {\n  c,\n} = modules.c;" in script and "export" not in script
    (tmp_path / "c.js").write_text('import { a } from "./a.js";\nexport const c = a;\n')
    with pytest.raises(AssertionError, match=r"a\.js imports itself, by a and b and c"):
        script_of("a")
    (tmp_path / "c.js").write_text("export default 1;\n")
    with pytest.raises(AssertionError, match=r"c\.js: unsupported import, export or tag"):
        script_of("c")


def test_all_sources_are_used() -> None:
    script = script_of("main")
    modules = sorted(assembly.FOLDER.glob("*.js"))
    assert len(modules) > 10
    for path in modules:
        assert path.read_text(encoding="utf-8").startswith("/* "), path.name
        assert f"modules.{path.stem} = " in script, path.name


def test_fingers_have_the_colours_of_other_pictures() -> None:
    found = re.findall(r"(\w+): \[(\d+), (\d+), (\d+)\]", (assembly.FOLDER / "shading.js").read_text(encoding="utf-8"))
    assert {name: tuple(map(int, rgb[::-1])) for name, *rgb in found} == COLOURS
