"""Input of a page: skeleton files, detected hands and untrusted names; also screens of any size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import KINECT2
from handpose.output.drawing.page.assembly import page
from handpose.output.drawing.page.content import content, hand
from layers.hand.kinematics import Kinematics
from netlib.proto import schema
from tests.handpose.output.drawing.page.conftest import ARM, any_body, body_of
from tests.handpose.output.drawing.page.page_reading import HAND, colours, joints_in, named, picture, slider, tip

Visit = Callable[..., Any]


def test_a_skeleton_file_is_chosen(visit: Visit, bare: Path, tmp_path: Path) -> None:
    """Its joints, sliders and limits are shown, with a note that it has no surface; a button restores the old body."""
    tab, file = visit(bare), tmp_path / "arm.prototxt"
    file.write_text(ARM)
    tab.locator("#file").set_input_files(file)
    named(tab, "arm: 4 joints, 3 of 3 DoFs free")
    slider(tab, "elbow").fill("90")
    expected = Kinematics(body_of(ARM)).joints(np.array([[0, 0, np.pi / 2]]))[0]
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    assert tab.locator("#no-surface").is_visible() and not tab.locator("#depth").is_visible()
    assert not tab.get_by_role("button", name="a pose").count()
    tab.get_by_role("button", name="This page's skeleton").click()
    assert len(joints_in(tab)) == 31 and tab.locator("#depth").is_visible()
    assert not tab.locator("#no-surface").is_visible()


def test_skeleton_files_are_dropped(visit: Visit, bare: Path) -> None:
    """Any valid body is shown; a broken file is reported with its line, and the previous body stays."""
    tab = visit(bare)

    def drop(text: str) -> None:
        given = tab.evaluate_handle(
            """(text) => {
              const data = new DataTransfer();
              data.items.add(new File([text], "mine.prototxt"));
              return data;
            }""",
            text,
        )
        tab.dispatch_event("body", "drop", {"dataTransfer": given})

    tab.mouse.move(*tip(tab, HAND.joint_names.index("thumb_tip")))  # the next body has no such joint
    drop(any_body(1))
    named(tab, "any 1")
    assert len(joints_in(tab)) == 12 and (colours(tab)[:, 3] == 255).mean() > 0.01
    drop(ARM.replace("length: 0.75", "lenght: 0.75"))
    tab.locator("#fault").filter(has_text="mine.prototxt:4:88: error: unknown field 'lenght'").wait_for()
    assert len(joints_in(tab)) == 12
    drop(ARM)
    named(tab, "arm")
    assert tab.locator("#fault").inner_text() == ""


def test_names_are_text_and_no_markup(visit: Visit, bare: Path, tmp_path: Path) -> None:
    """Names in an untrusted skeleton file are shown as text and not executed."""
    evil = '<img src=\\"x\\" onerror=\\"document.title=1\\">'
    text = ARM.replace('name: "hand"', f'name: "{evil}"').replace('"elbow"', f'"{evil}2"').replace('"arm"', f'"{evil}"')
    file, out = tmp_path / "evil.prototxt", tmp_path / "evil.html"
    file.write_text(text)
    tab = visit(bare)
    tab.locator("#file").set_input_files(file)
    named(tab, '<img src="x"')
    assert tab.evaluate("hand.body.source") == "evil.prototxt" and not tab.locator("img").count()
    skeleton = body_of(text, "</script><img src=x>.prototxt")
    out.write_text(page("<b>&", content(skeleton)), encoding="utf-8")
    tab = visit(out)
    assert tab.title() == "<b>&" and not tab.locator("img, b").count()
    assert tab.evaluate("hand.body.skeleton.joints[0]") == '<img src="x" onerror="document.title=1">'


def test_nothing_else_runs_and_nothing_is_fetched(browser: Any, bare: Path) -> None:
    """The browser blocks further scripts, handlers and requests in the page."""
    tab, said = browser.new_page(), []
    tab.on("console", lambda message: said.append(message.text))
    tab.goto(bare.as_uri())
    refused = tab.evaluate("""async () => {
      const script = document.createElement("script");
      script.textContent = "globalThis.ran = true";
      document.body.append(script);
      const fetched = await fetch("http://127.0.0.1:9/").then(() => "fetched", () => "refused");
      return [globalThis.ran ?? "nothing ran", fetched];
    }""")
    tab.close()
    assert refused == ["nothing ran", "refused"]
    assert sum("Content Security Policy" in line for line in said) >= 2


# ---------------------------------------------------------------------------------------------- detected hands


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A page with a right and a left hand, as seen by a camera, and the left one's joints (K, 3) in mm."""
    model, uvd, cube = CapsuleModel(HAND, 130.0), np.array([230.0, 190, 640]), 260.0
    rng = np.random.default_rng(5)
    x = model.variables_of(rng.uniform(-0.2, 0.2, (1, 47)))
    x[0, -2:] = 0.08, -0.05
    hands = []
    for side, flip in (("right", 1), ("left", -1)):
        center, mirror = KINECT2.unproject(uvd), np.array([flip, 1, 1])
        surface = model.capsules(x, np.zeros((1, 3)))
        seen = surface._replace(a=surface.a * mirror + center, b=surface.b * mirror + center)
        crop = normalise_depth(render_crop(seen, uvd[None], cube, KINECT2), uvd[2:], cube)[0]
        hands.append(hand(
            f"{side}.png", f"{side} hand, 90% sure", model.whole_inputs_of(x)[0], camera=KINECT2, center_uvd=uvd,
            cube_mm=cube, crop=crop, size=float(np.exp(x[0, -2])), thickness=float(np.exp(x[0, -1])), side=side,
        ))
    out = tmp_path_factory.mktemp("found") / "found.html"
    out.write_text(page("Hands", content(HAND, hands)), encoding="utf-8")
    return out, model.joints(x)[0] * (-1, 1, 1) + KINECT2.unproject(uvd)


def test_hands_that_were_found(visit: Visit, found: tuple[Path, np.ndarray]) -> None:
    """A hand chosen from the list is shown with its size, a left one mirrored; drawn and recorded depth agree."""
    path, joints = found
    tab = visit(path)
    assert tab.locator("#said").inner_text() == "right hand, 90% sure"
    tab.locator("#hands").select_option("left.png")
    assert tab.locator("#said").inner_text() == "left hand, 90% sure" and tab.get_by_label("left hand").is_checked()
    np.testing.assert_allclose(joints_in(tab)[:, :3], joints, atol=0.06)
    tab.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    drawn, seen = (picture(tab, name)[..., 0].astype(int) for name in ("depth", "seen"))
    assert (seen > 0).mean() > 0.1 and (np.abs(drawn - seen) > 1).mean() < 0.002
    with_points = colours(tab)
    tab.get_by_label("depth points").uncheck()
    blue = [(shown[:, 2].astype(int) > shown[:, 0].astype(int) + 60).mean() for shown in (with_points, colours(tab))]
    assert blue[0] > blue[1] + 0.01
    tab.get_by_label("left hand").uncheck()
    np.testing.assert_allclose(joints_in(tab)[:, 3] + joints_of_side(joints), 0, atol=1e-3)


def joints_of_side(joints: np.ndarray) -> np.ndarray:
    """x of joints in mm, in half-cubes from the crop's centre."""
    return (joints[:, 0] - KINECT2.unproject(np.array([230.0, 190, 640]))[0]) / 130.0


# ---------------------------------------------------------------------------------------------- screens


def test_a_phone_and_the_dark(visit: Visit, bare: Path) -> None:
    """Nothing is wider than the screen of a phone, and the background is dark if the system's theme is dark."""
    tab = visit(bare, viewport={"width": 320, "height": 800}, color_scheme="dark")
    tab.evaluate("hand.body.push(0, [90, -90, 90])")  # the widest rows
    for width in (320, 390):
        tab.set_viewport_size({"width": width, "height": 800})
        assert tab.evaluate("document.documentElement.scrollWidth") == width
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 28)"


def test_the_text_of_a_skeleton_in_a_page_is_the_skeleton(visit: Visit, bare: Path) -> None:
    """The skeleton is printed without loss of digits."""
    said = visit(bare).evaluate("hand.data.skeleton")
    assert said["source"] == "nyu.prototxt" and said["text"] == str(schema.to_tree(HAND.param))
    assert body_of(said["text"]).param == HAND.param


BIG = "\n".join(f'joint {{ name: "j{i}" }}' for i in range(1001))
WITH_SURFACE = ARM + "flesh { %s }"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ARM.replace("initial: 0.25", "fixed: constructor"), ":2:49: error: 'fixed' expects true or false, found con"),
        (BIG, ":1001:7: error: 1001 joints; this page shows at most 1000"),
        (BIG.replace("joint", "dof") + ARM, ":1001:5: error: 1004 DoFs; this page shows at most 1000"),
        (WITH_SURFACE % ('capsule { from: "hand" to: "hand" radius: 1 } ' * 1001), "1001 capsules; this"),
        (f'name: "{"x" * 10000}"', ":1:7: error: string of 10002 characters; at most 10000 are read"),
        ("\t# é\n é", ":2:2: error: unexpected character 'é'"),
        ("y" * 5000, ":1:5001: error: expected ':' or '{' after '" + "y" * 100),
        ("name: [" + "1, " * 200_000 + "1]", ":1:11: error: field 'name' is given twice"),
    ],
    ids=range(8),
)
def test_a_skeleton_file_that_is_refused(tab: Any, text: str, said: str) -> None:
    """The error is one short line with the place; the previous body stays."""
    tab.locator("#file").set_input_files({"name": "x.prototxt", "mimeType": "", "buffer": text.encode()})
    tab.locator("#fault").filter(has_text=said).wait_for()
    assert len(tab.locator("#fault").inner_text()) < 600 and len(joints_in(tab)) == 31


def test_joints_called_as_what_every_object_has(visit: Visit, bare: Path, tmp_path: Path) -> None:
    """Joints whose names are also properties of every JavaScript object are drawn like any other."""
    tab, file = visit(bare), tmp_path / "odd.prototxt"
    file.write_text(ARM.replace('"hand"', '"constructor"').replace('"elbow"', '"__proto__"'))
    tab.locator("#file").set_input_files(file)
    named(tab, "arm")
    assert (colours(tab)[:, 3] == 255).mean() > 1e-4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1e308 " * 47, "palm_x: 1e+308 is no pose; expected numbers up to 1000000"),
        ('dof { name: "palm_y" initial: nan }', "palm_y: nan is no pose"),
        ('dof { name: "palm_y" initial: -inf }', "palm_y: -inf is no pose"),
        ("[" * 50_000, "is not a number; expected 47 inputs"),
    ],
    ids=range(4),
)
def test_a_pose_that_is_refused(tab: Any, text: str, said: str) -> None:
    """An invalid pose is reported at once, and the inputs stay unchanged."""
    tab.locator("#pose").fill(text)
    assert said in tab.locator("#pose-fault").inner_text()
    assert tab.evaluate("hand.body.inputs.every((value) => Math.abs(value) < 10)")


def test_a_number_that_is_too_large_is_not_taken(visit: Visit, bare: Path) -> None:
    """A number out of range, typed into the field of a slider, is not accepted."""
    tab = visit(bare)
    number = tab.locator(".dof input[type=number]").first
    number.fill("1e308")
    number.press("Enter")
    assert tab.evaluate("hand.body.inputs[0]") == 0
