"""handpose/output/hand_page/assembly.py"""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from handpose.output.drawing.hands import FINGER_COLOURS
from handpose.output.hand_page import assembly
from handpose.output.hand_page.assembly import escaped, script_of
from handpose.output.live.page import LIVE_FOLDER as LIVE


@pytest.mark.parametrize(
    "evil",
    ["</script><script>", "<!--<script>", "]]>", "&lt;", "\u2028'\"\\", "\ud800"],
    ids=["script", "comment", "CDATA", "entity", "quotes", "surrogate"],
)
def test_data_cannot_leave_their_place(evil: str) -> None:
    text = escaped({evil: [evil]})
    assert not set(text) & set("<>&") and text.isascii()
    assert json.loads(text) == {evil: [evil]}


def test_modules_stand_after_those_that_they_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each module occurs once, after its imports; other modules can import only its exports."""
    (tmp_path / "a.js").write_text(
        'import { b } from "./b.js";\nimport { c } from "./c.js";\nexport const a = b + c;\n'
    )
    (tmp_path / "b.js").write_text(
        'import {\n  c,\n} from "./c.js";\nexport function b() {\n  return c;\n}\n'
    )
    (tmp_path / "c.js").write_text("const own = 1;\nexport const c = own;\nexport class D {}\n")
    monkeypatch.setattr(assembly, "FOLDER", tmp_path)
    script = script_of("a")
    assert re.findall(r"^modules\.(\w) = ", script, re.MULTILINE) == ["c", "b", "a"]
    assert "return { D, c };" in script
    assert "const {\n  c,\n} = modules.c;" in script
    assert "export" not in script
    (tmp_path / "c.js").write_text("export default 1;\n")
    with pytest.raises(AssertionError, match=r"c\.js: unsupported import, export or tag"):
        script_of("c")


@pytest.mark.parametrize(
    ("folder", "first"),
    [(assembly.FOLDER, ["main"]), (LIVE, ["live", "without_token"])],
    ids=["hand page", "live page"],
)
def test_all_sources_are_used(folder: Path, first: list[str]) -> None:
    script = "".join(script_of(name, folder) for name in first)
    assert "modules.body_view = " in script  # both pages show bodies
    for path in folder.glob("*.js"):
        assert path.read_text(encoding="utf-8").startswith("/* "), path.name
        assert f"modules.{path.stem} = " in script, path.name


def test_fingers_have_the_colours_of_other_pictures() -> None:
    found = re.findall(
        r"(\w+): \[(\d+), (\d+), (\d+)\]",
        (assembly.FOLDER / "shading.js").read_text(encoding="utf-8"),
    )
    assert {name: tuple(map(int, rgb[::-1])) for name, *rgb in found} == FINGER_COLOURS
