"""The page in use: sliders, buttons, the mouse, the keyboard."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from docs.making import pages
from layers.hand.kinematics import Kinematics
from tests.handpose.output.drawing.page.page_reading import HAND, colours, inputs_in, joints_in, joints_of, slider, tip

Visit = Callable[..., Any]


@pytest.fixture(scope="module")
def packaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the documents, with three bodies."""
    path = tmp_path_factory.mktemp("packaged") / "hand.html"
    path.write_text(pages.hand(), encoding="utf-8")
    return path


def test_there_is_a_labelled_slider_for_every_free_dof(visit: Visit, bare: Path) -> None:
    """28 sliders, two of them for the forearm, which belongs to the surface; fixed DoFs are shown on request."""
    tab = visit(bare)
    free = [d.name for d in HAND.with_surface().param.dof if not d.fixed]
    names = tab.locator("input[type=range]").evaluate_all("(all) => all.map((one) => one.dataset.dof)")
    assert sorted(names) == sorted(free) and len(free) == 28
    unlabelled = "(all) => all.filter((one) => !one.labels.length && !one.ariaLabel).map((one) => one.outerHTML)"
    assert tab.locator("input, select, textarea").evaluate_all(unlabelled) == []
    assert tab.locator(".dof").first.locator(".limits").inner_text() == "free"
    assert slider(tab, "thumb_tip_rot_z").locator("xpath=..").locator(".limits").inner_text() == "-13 to 31"
    tab.get_by_label("fixed DoFs").check()
    assert tab.locator(".dof.fixed").count() == 47 - 26 + 3


def test_sliders_and_numbers_move_the_hand(visit: Visit, bare: Path) -> None:
    """Values are in degrees and mm; the table shows the joints of the kinematics, and the text the inputs."""
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
    """A slider reacts to the arrow keys."""
    tab = visit(bare)
    slider(tab, "ring_pip_rot_x").focus()
    tab.keyboard.press("ArrowLeft")
    assert inputs_in(tab)["ring_pip_rot_x"] < 0


def test_beyond_a_limit(visit: Visit, bare: Path) -> None:
    """The row is marked and the loss equals that of PhysLimit; back within the limits, both are reset."""
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
    """A random pose respects limits and keeps the palm; a named pose sets its DoFs; the initial pose sets all to 0."""
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
    """A list from Python or DoFs as prototxt are accepted; other text gives an error of one line and no change."""
    tab = visit(bare)
    inputs = np.round(np.random.default_rng(0).normal(0, 0.5, 47), 4)
    expected = Kinematics(HAND).joints(inputs[None])[0]
    tab.locator("#pose").fill(f"inputs = np.array({inputs.tolist()})")
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    for wrong, line in [
        ("[1, 2, 3]", "3 numbers; skeleton 'nyu' has 47 inputs"),
        ('{"angles_rad": {"nose": 1}}', "unknown DoF 'nose'; skeleton 'nyu' has palm_x, palm_y, palm_z ..."),
        ('{"angles_rad": {1}}', "angles_rad is not whole JSON"),
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
    theta = HAND.theta(inputs)
    angles = {name: round(value, 5) for name, value in zip(HAND.dof_names, theta) if "rot" in name}
    tab.locator("#pose").fill(json.dumps({"hands": [{"angles_rad": angles, "crop": {}}]}, indent=2))
    np.testing.assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)


# ---------------------------------------------------------------------------------------------- the picture


def test_the_mouse_and_the_keyboard_turn_the_picture(visit: Visit, bare: Path) -> None:
    """Dragging turns the view, the wheel zooms, a double click resets; the joints do not move."""
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


def test_the_surface_is_drawn_where_it_is(visit: Visit, bare: Path) -> None:
    """The surface is drawn, and without it only lines; the name of the joint under the mouse is shown."""
    tab = visit(bare)
    assert 0.05 < (colours(tab)[:, 3] == 255).mean() < 0.5
    tab.get_by_label("surface", exact=True).uncheck()
    assert 0.001 < (colours(tab)[:, 3] == 255).mean() < 0.03
    tab.get_by_label("skeleton", exact=True).uncheck()
    bare_picture = (colours(tab)[:, 3] > 0).sum()  # axes and scale alone
    assert 0 < bare_picture < 4000
    tab.mouse.move(*tip(tab, HAND.joint_names.index("index_tip")))
    assert re.fullmatch(r"index_tip: 69\.2, 125\.4, 643\.2 mm", tab.locator("#under").inner_text())
    assert (colours(tab)[:, 3] > 0).sum() > bare_picture + 1000  # the joint's name
    slider(tab, "index_pip_rot_x").fill("-45")
    assert not tab.locator("#under").inner_text().startswith("index_tip: 69.2, 125.4")  # the tip has moved
    tab.evaluate("hand.body.open(hand.data.skeleton.text, 'again')")
    assert tab.locator("#under").inner_text() == ""


def test_the_whole_reach_is_in_the_picture(visit: Visit, packaged: Path) -> None:
    """No joint of the hand or of the book's arm leaves the picture in any pose within the limits."""
    outside = """() => {
      const { body, stage: { viewer } } = hand, { lower, upper } = body.whole;
      let most = 0, seed = 1;
      const random = () => (seed = seed * 16807 % 2147483647) / 2147483647;
      const draw = (d) => body.whole.limits(d).every(Number.isFinite) ? lower[d] + random() * (upper[d] - lower[d])
        : body.isPlace(d) ? 0 : (2 * random() - 1) * Math.PI;
      for (let n = 0; n < 300; n++) {
        body.move(Object.fromEntries([...body.whole.dofs.keys()].map((d) => [d, draw(d)])));
        for (const joint of body.joints.slice(0, body.skeleton.joints.length)) {
          const [u, v] = viewer.pixel(joint);
          most = Math.max(most, Math.abs(2 * u / viewer.width - 1), Math.abs(2 * v / viewer.height - 1));
        }
      }
      return most;
    }"""
    for name in ("hand", "arm"):
        tab = visit(packaged, fragment=f"body={name}")
        assert 0.4 < tab.evaluate(outside) < 1


def test_an_address_sets_body_pose_and_force(visit: Visit, packaged: Path) -> None:
    """An address as in chapters 6 and 7 sets their arm, its wrist at (3, 6), and torques of 0 and -300 N mm."""
    tab = visit(packaged, fragment="body=arm&shoulder=53.13&elbow=36.87&force=wrist,1,2,0&nose=1&force=wrist,2")
    np.testing.assert_allclose(joints_in(tab)[:, 3:], [[3, 4, 0], [3, 6, 0]], atol=1e-4)
    assert tab.locator(".torque").all_inner_texts() == ["0.0 N mm", "-300 N mm"]
    assert tab.locator("#bodies").input_value() == "arm"
    tab.locator("#bodies").select_option("hand")
    assert joints_in(tab).shape == (31, 6)


def test_a_force_is_dragged_at_a_fingertip(visit: Visit, bare: Path) -> None:
    """A force is dragged in the picture's plane, in proportion; the bars show torques; other joints must be enabled."""
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
        tab.get_by_label("drag any joint").set_checked(anywhere)
        tab.evaluate("scrollTo(0, 0)")
        x, y = tip(tab, palm)
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x + 30, y)
        tab.mouse.up()
        assert np.any(tab.evaluate(f"hand.body.forces[{palm}]")) == anywhere


def test_a_force_in_numbers(visit: Visit, bare: Path) -> None:
    """A force can also be entered as numbers."""
    tab = visit(bare)
    tab.locator("#force-joint").select_option("thumb_tip")
    tab.locator("#force-z").fill("2.5")
    assert tab.evaluate(f"hand.body.forces[{HAND.joint_names.index('thumb_tip')}]") == [0, 0, 2.5]
    assert tab.locator("#force-note").inner_text() == "2.50 N here; forces on 1 joint"


def test_the_camera(visit: Visit, bare: Path) -> None:
    """After a change of camera and distance the body moves with the middle of the crop."""
    tab = visit(bare)
    tab.locator("#camera").select_option("kinect2")
    tab.locator("#distance").fill("900")
    tab.locator("#distance").press("Enter")
    found = joints_in(tab)
    np.testing.assert_allclose(found[:, :3], found[:, 3:] * 150 + (0, 0, 900), atol=0.06)
    assert tab.locator("#cube").inner_text() == "300 mm about u 255, v 206"
