"""handpose/output/hand_page/assembly.py"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

from handpose.frames.cameras import ICVL, KINECT2, NYU, Camera
from handpose.frames.crops import SIZE, crop
from handpose.output.drawing.hands import COLOURS
from handpose.output.hand_page import assembly
from handpose.output.hand_page.assembly import crop_points, escaped, hand, page, script_of


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


@pytest.mark.parametrize("camera", [NYU, KINECT2, ICVL], ids=lambda camera: camera.name)
def test_points_are_where_the_camera_saw_them(camera: Camera) -> None:
    """Every pixel of the frame within the cube yields one point, as unprojected by the camera; no others do."""
    rng, uvd = np.random.default_rng(0), np.array([camera.u0 + 15, camera.v0 - 20, 800.0])
    frame = rng.uniform(500, 1100, (camera.height, camera.width)).astype(np.float32)
    frame[rng.random(frame.shape) < 0.3] = 0
    found = crop_points(crop(frame, uvd, 300.0, camera), uvd, 300.0, camera)
    pixels = camera.project(found + camera.unproject(uvd))
    columns, rows = (np.rint(pixels[:, i]).astype(int) for i in (0, 1))
    np.testing.assert_allclose(pixels[:, :2], np.stack([columns, rows], axis=1), atol=1e-6)
    np.testing.assert_allclose(pixels[:, 2], frame[rows, columns], atol=1e-3)
    assert len(np.unique(pixels[:, :2].round(), axis=0)) == len(found) > 1000
    assert (np.abs(found[:, 2]) < 150).all()


def test_a_crop_beside_the_image() -> None:
    uvd = np.array([3.0, 3, 700])
    frame = np.full((480, 640), 700, np.float32)
    found = crop_points(crop(frame, uvd, 300.0), uvd, 300.0, NYU)
    pixels = NYU.project(found + NYU.unproject(uvd))
    assert pixels[:, :2].min() == pytest.approx(0, abs=1e-6) and len(found) > 100
    assert crop_points(np.ones((SIZE, SIZE), np.float32), uvd, 300.0, NYU).shape == (0, 3)


@pytest.mark.parametrize("cube", [260.0, 30000.0])
def test_a_hand_as_values(cube: float) -> None:
    """Points and crop are stored in 16 bits for any size of the cube."""
    rng, uvd = np.random.default_rng(1), np.array([250.0, 200, 50.0 + cube])
    seen = rng.uniform(-1.2, 1, (SIZE, SIZE)).clip(-1, 1).astype(np.float32)
    made = hand("a.png", "a hand", np.zeros(47), camera=KINECT2, center_uvd=uvd, cube_mm=cube, crop=seen)
    points = np.frombuffer(base64.b64decode(made["points"]), "<i2").reshape(-1, 3) * made["step_mm"]
    np.testing.assert_allclose(points, crop_points(seen, uvd, cube, KINECT2), atol=made["step_mm"])
    assert made["step_mm"] <= cube / 30000 * 2
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(made["crop"]), "<i2") / 32767, seen.ravel(), atol=2e-5)
    assert made["place"]["unit_mm"] == cube / 2 and len(made["inputs"]) == 47
