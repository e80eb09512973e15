"""The page as one uses it: sliders, buttons, the mouse, the keyboard, files."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.drawing.page.assembly import page
from handpose.drawing.page.content import content, hand
from handpose.facts.cameras import KINECT2
from handpose.fitting.depth.body import FleshModel
from handpose.flesh.render import normalise_depth, render_crop
from layers.hand import skeleton as skeletons
from layers.hand.kinematics import Kinematics
from netlib import schema
from tests.handpose.drawing.page.conftest import ARM, any_body, body_of

HAND = skeletons.load()
Visit = Callable[..., Any]


def joints_in(tab: Any) -> np.ndarray:
    """The table of joints (K, 6): mm from the camera, and half-cubes from the crop's centre."""
    return np.array([row.split("\t")[1:] for row in tab.locator("#joints tr").all_inner_texts()], dtype=float)


def joints_of(inputs: dict[str, float]) -> np.ndarray:
    """The joints (K, 3) that Python has of the hand, from inputs by name."""
    row = np.zeros((1, len(HAND.initial)))
    for name, value in inputs.items():
        row[0, HAND.dof_names.index(name)] = value
    return Kinematics(HAND).joints(row)[0]


def inputs_in(tab: Any) -> dict[str, float]:
    """The pose as the page writes it, by name, without what is 0."""
    line = json.loads(tab.locator("#pose").input_value())
    return {name: value for name, value in zip(HAND.dof_names, line) if value}


def named(tab: Any, name: str) -> None:
    """Wait until the page shows a body whose name begins so."""
    tab.locator("#name").filter(has_text=re.compile(f"^{re.escape(name)}")).wait_for()


def slider(tab: Any, name: str) -> Any:
    """The slider of a DoF."""
    return tab.locator(f'input[data-dof="{name}"]')


# ---------------------------------------------------------------------------------------------- sliders and buttons


def test_there_is_a_labelled_slider_for_every_free_dof(visit: Visit, bare: Path) -> None:
    """26, and two of the forearm, which only the flesh has; the fixed ones on demand, as numbers."""
    tab = visit(bare)
    free = [d.name for d in HAND.with_flesh().param.dof if not d.fixed]
    names = tab.locator("input[type=range]").evaluate_all("(all) => all.map((one) => one.dataset.dof)")
    assert sorted(names) == sorted(free) and len(free) == 28
    unlabelled = "(all) => all.filter((one) => !one.labels.length && !one.ariaLabel).map((one) => one.outerHTML)"
    assert tab.locator("input, select, textarea").evaluate_all(unlabelled) == []
    assert tab.locator(".dof").first.locator(".limits").inner_text() == "free"
    assert slider(tab, "thumb_tip_rot_z").locator("xpath=..").locator(".limits").inner_text() == "-13 to 31"
    tab.get_by_label("fixed DoFs").check()
    assert tab.locator(".dof.fixed").count() == 47 - 26 + 3


def test_sliders_and_numbers_move_the_hand(visit: Visit, bare: Path) -> None:
    """In degrees and mm; the table has the joints that the kinematics has, and the text the inputs."""
    tab = visit(bare)
    np.testing.assert_allclose(joints_in(tab)[:, 3:], joints_of({}), atol=6e-5)
    slider(tab, "index_pip_rot_x").fill("-45")
    box = slider(tab, "palm_x").locator("xpath=..").locator("input[type=number]")
    box.fill("30")
    box.press("Enter")
    expected = joints_of({"index_pip_rot_x": -np.pi / 4, "palm_x": 30 / 150})
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    np.testing.assert_allclose(joints_in(tab)[:, :3], expected * 150 + (0, 0, 700), atol=0.06)
    assert inputs_in(tab) == pytest.approx({"index_pip_rot_x": -np.pi / 4, "palm_x": 0.2}, abs=1e-8)


def test_the_keyboard_moves_a_slider(visit: Visit, bare: Path) -> None:
    """It is a real input."""
    tab = visit(bare)
    slider(tab, "ring_pip_rot_x").focus()
    tab.keyboard.press("ArrowLeft")
    assert inputs_in(tab)["ring_pip_rot_x"] < 0


def test_beyond_a_limit(visit: Visit, bare: Path) -> None:
    """The row is marked, and the loss is that of PhysLimit; back within, neither."""
    tab = visit(bare)
    thumb, row = slider(tab, "thumb_tip_rot_z"), slider(tab, "thumb_tip_rot_z").locator("xpath=..")
    assert "beyond" not in row.get_attribute("class")
    number = row.locator("input[type=number]")
    number.fill("60")
    number.press("Enter")
    over = np.deg2rad(60) - HAND.upper[HAND.dof_names.index("thumb_tip_rot_z")]
    assert "beyond" in row.get_attribute("class") and "beyond its limit" in row.get_attribute("title")
    assert tab.locator("#limit-loss").inner_text() == f"limit loss {over:.4f} (L1), {over**2:.4f} (L2)"
    thumb.fill("20")
    assert "beyond" not in row.get_attribute("class")
    assert tab.locator("#limit-loss").inner_text() == "limit loss 0.0000 (L1), 0.0000 (L2)"


def test_buttons(visit: Visit, bare: Path) -> None:
    """A random pose is within the limits and leaves the palm; a named one sets its DoFs; the initial one is all 0."""
    tab = visit(bare)
    tab.get_by_role("button", name="Random pose").click()
    found = inputs_in(tab)
    assert len(found) == 20 and not any(name.startswith("palm") for name in found)
    for name, value in found.items():
        d = HAND.dof_names.index(name)
        assert HAND.lower[d] <= value <= HAND.upper[d]
    tab.get_by_role("button", name="Initial pose").click()
    assert inputs_in(tab) == {}
    tab.get_by_role("button", name="a pose").click()
    assert inputs_in(tab) == {"index_pip_rot_x": -0.5, "thumb_tip_rot_z": 0.25}


def test_pasting_a_pose(visit: Visit, bare: Path) -> None:
    """A list, as Python writes one, or DoFs; what is neither is told in one line and changes nothing."""
    tab = visit(bare)
    inputs = np.round(np.random.default_rng(0).normal(0, 0.5, 47), 4)
    expected = Kinematics(HAND).joints(inputs[None])[0]
    tab.locator("#pose").fill(f"inputs = np.array({inputs.tolist()})")
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    for wrong, line in [
        ("[1, 2, 3]", "3 numbers; skeleton 'nyu' has 47 inputs"),
        ("a pose", "'a' is not a number; expected 47 inputs or dof { ... }"),
        ('dof { name: "nose" }', "unknown DoF 'nose'; skeleton 'nyu' has palm_x, palm_y, palm_z ..."),
        ('dof { name: "palm_x" }\njoint { }', "pose:2:1: error: found 'joint'; expected dof { ... } alone"),
    ]:
        tab.locator("#pose").fill(wrong)
        assert tab.locator("#pose-fault").inner_text() == line
        np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    tab.locator("#pose").fill('dof { name: "palm_x" initial: 0.5 }')
    expected += (0.5 - HAND.initial[0] - inputs[0], 0, 0)
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    assert tab.locator("#pose-fault").inner_text() == ""


# ---------------------------------------------------------------------------------------------- the picture


def tip(tab: Any, joint: int) -> tuple[float, float]:
    """Where a joint is in the window."""
    box = tab.locator("#stage").bounding_box()
    u, v, _ = tab.evaluate(f"hand.stage.viewer.pixel(hand.body.joints[{joint}])")
    return box["x"] + u, box["y"] + v


def colours(tab: Any) -> np.ndarray:
    """The picture's pixels (n, 4), finely drawn."""
    tab.evaluate("hand.stage.draw(1)")
    return picture(tab, "stage").reshape(-1, 4)


def picture(tab: Any, canvas: str) -> np.ndarray:
    """The pixels (height, width, 4) of a canvas: red, green, blue, how much it covers."""
    png = tab.evaluate(f"document.getElementById('{canvas}').toDataURL()").partition(",")[2]
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(png), np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels[..., [2, 1, 0, 3]]


def test_the_mouse_and_the_keyboard_turn_the_picture(visit: Visit, bare: Path) -> None:
    """A drag turns what is before the middle along with it, the wheel zooms, a double click resets; no joint moves."""
    tab = visit(bare)
    state = "JSON.stringify([hand.stage.viewer.turned, hand.stage.viewer.zoom])"
    first, table = tab.evaluate(state), joints_in(tab)
    box = tab.locator("#stage").bounding_box()
    tab.mouse.move(box["x"] + 20, box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 60, box["y"] + 50, steps=3)
    tab.mouse.up()
    nearer = "(([x, y, z]) => hand.stage.viewer.pixel([x, y, z - 50]))(hand.stage.viewer.middle)"
    u, v, _ = tab.evaluate(nearer)
    assert u > box["width"] / 2 + 5 and v > box["height"] / 2 + 5
    tab.dispatch_event("#stage", "wheel", {"deltaY": -200})
    assert tab.evaluate("hand.stage.viewer.zoom") > 1.2
    tab.mouse.dblclick(box["x"] + 20, box["y"] + 20)
    assert tab.evaluate(state) == first
    tab.locator("#stage").press("ArrowRight")
    tab.locator("#stage").press("-")
    assert tab.evaluate(state) != first and tab.evaluate("hand.stage.viewer.zoom") < 1
    tab.locator("#stage").press("0")
    assert tab.evaluate(state) == first
    np.testing.assert_array_equal(joints_in(tab), table)


def test_the_flesh_is_drawn_where_it_is(visit: Visit, bare: Path) -> None:
    """Skin in the picture, and with the box unchecked only lines; the name of the joint under the mouse is told."""
    tab = visit(bare)
    assert 0.05 < (colours(tab)[:, 3] == 255).mean() < 0.5
    tab.get_by_label("flesh", exact=True).uncheck()
    assert 0.001 < (colours(tab)[:, 3] == 255).mean() < 0.03
    tab.get_by_label("skeleton", exact=True).uncheck()
    assert not colours(tab)[:, 3].any()
    tab.mouse.move(*tip(tab, HAND.joint_names.index("index_tip")))
    assert re.fullmatch(r"index_tip: 69\.2, 125\.4, 643\.2 mm", tab.locator("#under").inner_text())
    assert colours(tab)[:, 3].any()  # its name


def test_a_force_is_dragged_at_a_fingertip(visit: Visit, bare: Path) -> None:
    """In the plane of the picture, in proportion; the bars have the torques; at other joints if one wants."""
    tab, j = visit(bare), HAND.joint_names.index("ring_tip")
    x, y = tip(tab, j)
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 40, y + 25, steps=2)
    tab.mouse.up()
    depth = tab.evaluate(f"hand.stage.viewer.pixel(hand.body.joints[{j}])[2]")
    focal, reach = tab.evaluate("[hand.stage.viewer.focal, hand.stage.viewer.reach]")
    force = np.array([40, -25, 0]) * depth / focal / (reach / 32)
    np.testing.assert_allclose(tab.evaluate(f"hand.body.forces[{j}]"), force, atol=0.05)
    assert [float(tab.locator(f"#force-{axis}").input_value()) for axis in "xyz"] == pytest.approx(force, abs=0.05)
    kinematics, forces = Kinematics(HAND), np.zeros((1, 31, 3))
    forces[0, j] = tab.evaluate(f"hand.body.forces[{j}]")
    torques = kinematics.backward(kinematics.forward(np.zeros((1, 47))), forces)[0]
    for name, unit, scale in (("palm_y", "N", 1), ("ring_base_rot_x", "N mm", 150), ("palm_rot_z", "N mm", 150)):
        said = slider(tab, name).locator("xpath=..").locator(".torque").inner_text()
        assert said.endswith(f" {unit}")
        torque = torques[HAND.dof_names.index(name)] * scale
        assert float(said.split()[0]) == pytest.approx(torque, abs=0.05 if abs(torque) < 100 else 0.5)
    assert slider(tab, "index_pip_rot_x").locator("xpath=..").locator(".torque").inner_text() == ""
    tab.get_by_role("button", name="No force").click()
    assert not np.any(tab.evaluate("hand.body.forces"))
    palm = HAND.joint_names.index("palm")
    for anywhere in (False, True):
        tab.get_by_label("drag at any joint").set_checked(anywhere)
        tab.evaluate("scrollTo(0, 0)")
        x, y = tip(tab, palm)
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x + 30, y)
        tab.mouse.up()
        assert np.any(tab.evaluate(f"hand.body.forces[{palm}]")) == anywhere


def test_a_force_in_numbers(visit: Visit, bare: Path) -> None:
    """For who does not drag."""
    tab = visit(bare)
    tab.locator("#force-joint").select_option("thumb_tip")
    tab.locator("#force-z").fill("2.5")
    assert tab.evaluate(f"hand.body.forces[{HAND.joint_names.index('thumb_tip')}]") == [0, 0, 2.5]
    assert tab.locator("#force-note").inner_text() == "2.50 N here; forces on 1 joint"


def test_the_camera(visit: Visit, bare: Path) -> None:
    """Another one, and another distance: the body moves with the crop's middle."""
    tab = visit(bare)
    tab.locator("#camera").select_option("kinect2")
    tab.locator("#distance").fill("900")
    tab.locator("#distance").press("Enter")
    found = joints_in(tab)
    np.testing.assert_allclose(found[:, :3], found[:, 3:] * 150 + (0, 0, 900), atol=0.06)
    assert tab.locator("#cube").inner_text() == "300 mm about u 255, v 206"


# ---------------------------------------------------------------------------------------------- files


def test_a_skeleton_file_is_chosen(visit: Visit, bare: Path, tmp_path: Path) -> None:
    """Its joints, sliders and limits; it has no flesh, and the page says so. And back."""
    tab, file = visit(bare), tmp_path / "arm.prototxt"
    file.write_text(ARM)
    tab.locator("#file").set_input_files(file)
    named(tab, "arm: 4 joints, 3 of 3 DoFs free")
    slider(tab, "elbow").fill("90")
    expected = Kinematics(body_of(ARM)).joints(np.array([[0, 0, np.pi / 2]]))[0]
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    assert tab.locator("#no-flesh").is_visible() and not tab.get_by_role("button", name="a pose").count()
    tab.get_by_role("button", name="This page's skeleton").click()
    assert len(joints_in(tab)) == 31 and not tab.locator("#no-flesh").is_visible()


def test_skeleton_files_are_dropped(visit: Visit, bare: Path) -> None:
    """Any body is shown; a broken one is told by its line, and the body that was there stays."""
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
    """Whatever a stranger's skeleton is called, it is shown and not run."""
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
    """The browser refuses further scripts, handlers and requests, whoever puts them into the page."""
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


# ---------------------------------------------------------------------------------------------- hands that were found


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A page with a right hand and a left one, as a camera sees them, and the left one's joints (K, 3) in mm."""
    model, uvd, cube = FleshModel(HAND, 130.0), np.array([230.0, 190, 640]), 260.0
    rng = np.random.default_rng(5)
    x = model.variables_of(rng.uniform(-0.2, 0.2, (1, 47)))
    x[0, -2:] = 0.08, -0.05
    hands = []
    for side, flip in (("right", 1), ("left", -1)):
        center, mirror = KINECT2.unproject(uvd), np.array([flip, 1, 1])
        flesh = model.capsules(x, np.zeros((1, 3)))
        seen = flesh._replace(a=flesh.a * mirror + center, b=flesh.b * mirror + center)
        crop = normalise_depth(render_crop(seen, uvd[None], cube, KINECT2), uvd[2:], cube)[0]
        hands.append(hand(
            f"{side}.png", f"{side} hand, 90% sure", model.whole_inputs_of(x)[0], camera=KINECT2, center_uvd=uvd,
            cube_mm=cube, crop=crop, size=float(np.exp(x[0, -2])), girth=float(np.exp(x[0, -1])), side=side,
        ))  # fmt: skip
    out = tmp_path_factory.mktemp("found") / "found.html"
    out.write_text(page("Hands", content(HAND, hands)), encoding="utf-8")
    return out, model.joints(x)[0] * (-1, 1, 1) + KINECT2.unproject(uvd)


def test_hands_that_were_found(visit: Visit, found: tuple[Path, np.ndarray]) -> None:
    """Chosen from a list: joints with their size, mirrored for a left hand; the depth drawn is the depth seen."""
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
    """x in half-cubes from the crop's centre of joints in mm."""
    return (joints[:, 0] - KINECT2.unproject(np.array([230.0, 190, 640]))[0]) / 130.0


# ---------------------------------------------------------------------------------------------- screens


def test_a_phone_and_the_dark(visit: Visit, bare: Path) -> None:
    """Nothing is wider than a phone; dark paper where the system is dark."""
    tab = visit(bare, viewport={"width": 390, "height": 800}, color_scheme="dark")
    tab.evaluate("hand.body.push(0, [90, -90, 90])")  # the widest rows
    assert tab.evaluate("document.documentElement.scrollWidth") == 390
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 23, 28)"


def test_the_text_of_a_skeleton_in_a_page_is_the_skeleton(visit: Visit, bare: Path) -> None:
    """To the last digit: it is printed as it was read."""
    said = visit(bare).evaluate("hand.data.skeleton")
    assert said["source"] == "nyu.prototxt" and said["text"] == str(schema.to_tree(HAND.param))
    assert body_of(said["text"]).param == HAND.param
