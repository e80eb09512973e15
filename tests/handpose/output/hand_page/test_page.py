"""The hand page in use: sliders, buttons, the mouse, the keyboard; predicted hands, untrusted
names, small screens.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from docs.making import pages
from handpose.body.render import normalise_depth, render_crop
from handpose.fit.body import CapsuleModel
from handpose.frames.cameras import KINECT2
from handpose.output.hand_page.assembly import page
from handpose.output.hand_page.values import body, hand
from layers.hand import skeleton as skeletons
from layers.hand.kinematics import Kinematics
from tests.handpose.output.hand_page.conftest import ARM
from tests.support.chromium_tabs import picture
from tests.support.made_tracks import skeleton_of

Visit = Callable[..., Any]
HAND = skeletons.load()


@pytest.fixture(scope="module")
def packaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the documents, with four bodies."""
    path = tmp_path_factory.mktemp("packaged") / "hand.html"
    path.write_text(pages.hand(), encoding="utf-8")
    return path


def joints_in(tab: Any) -> np.ndarray:
    """The table of joints (K, 6): mm from the camera, and half-cubes from the crop's centre."""
    return np.array(
        [row.split("\t")[1:] for row in tab.locator("#joints tr").all_inner_texts()], dtype=float
    )


def joints_of(inputs: dict[str, float]) -> np.ndarray:
    """The joints (K, 3) that Python computes for the NYU hand, from inputs by name."""
    row = np.zeros((1, len(HAND.initial)))
    for name, value in inputs.items():
        row[0, HAND.dof_names.index(name)] = value
    return Kinematics(HAND).joints(row)[0]


def inputs_in(tab: Any) -> dict[str, float]:
    """The pose as written by the page, by name, without zeros."""
    numbers = json.loads(tab.locator("#pose").input_value())
    return {name: value for name, value in zip(HAND.dof_names, numbers) if value}


def slider(tab: Any, name: str) -> Any:
    return tab.locator(f'input[data-dof="{name}"]')


def row(tab: Any, name: str) -> Any:
    return slider(tab, name).locator("xpath=..")


def position(tab: Any, joint: int) -> tuple[float, float]:
    """The position of a joint in the window."""
    box = tab.locator("#view").bounding_box()
    u, v, _ = tab.evaluate(f"hand.view.camera.project(hand.body.joints[{joint}])")
    return box["x"] + u, box["y"] + v


def colours(tab: Any) -> np.ndarray:
    """The pixels (n, 4) of the 3-D view."""
    return picture(tab, "view", draw="hand.view.draw(1)").reshape(-1, 4)


def enter(field: Any, value: str) -> None:
    field.fill(value)
    field.press("Enter")


# -------------------------------------------------------------------------------------------- poses


def test_there_is_a_labelled_slider_for_every_free_dof(visit: Visit, bare: Path) -> None:
    """28 sliders, two of them for the forearm, which belongs to the surface; fixed DoFs are
    shown on request.
    """
    tab = visit(bare)
    free = [d.name for d in HAND.with_surface().param.dof if not d.fixed]
    names = tab.locator("input[type=range]").evaluate_all(
        "(all) => all.map((one) => one.dataset.dof)"
    )
    assert sorted(names) == sorted(free) and len(free) == 28
    unlabelled = "(all) => all.filter((one) => !one.labels.length && !one.ariaLabel).map((one) => one.outerHTML)"
    assert tab.locator("input, select, textarea").evaluate_all(unlabelled) == []
    assert tab.locator(".dof").first.locator(".limits").inner_text() == "free"
    assert row(tab, "thumb_tip_rot_z").locator(".limits").inner_text() == "-13 to 31"
    tab.get_by_label("fixed DoFs").check()
    assert tab.locator(".dof.fixed").count() == 47 - 26 + 3


def test_sliders_and_numbers_move_the_hand(visit: Visit, bare: Path) -> None:
    """Values are in degrees and mm; the table shows the joints of the kinematics, and the
    text the inputs.
    """
    tab = visit(bare)
    assert_allclose(joints_in(tab)[:, 3:], joints_of({}), atol=6e-5)
    slider(tab, "index_pip_rot_x").fill("-45")
    enter(row(tab, "palm_x").locator("input[type=number]"), "30")
    expected = joints_of({"index_pip_rot_x": -np.pi / 4, "palm_x": 30 / 150})
    assert_allclose(joints_in(tab)[:, 3:], expected, atol=6e-5)
    assert_allclose(joints_in(tab)[:, :3], expected * 150 + (0, 0, 700), atol=0.06)
    assert inputs_in(tab) == pytest.approx({"index_pip_rot_x": -np.pi / 4, "palm_x": 0.2}, abs=1e-8)
    slider(tab, "ring_pip_rot_x").press("ArrowLeft")
    assert inputs_in(tab)["ring_pip_rot_x"] < 0


def test_beyond_a_limit(visit: Visit, bare: Path) -> None:
    """The row is marked and the loss equals that of PhysLimit; back within the limits,
    both are reset.
    """
    tab = visit(bare)
    thumb = row(tab, "thumb_tip_rot_z")
    assert "beyond" not in thumb.get_attribute("class")
    enter(thumb.locator("input[type=number]"), "60")
    over = np.deg2rad(60) - HAND.upper[HAND.dof_names.index("thumb_tip_rot_z")]
    assert "beyond" in thumb.get_attribute("class")
    assert "beyond its limit" in thumb.get_attribute("title")
    assert (
        tab.locator("#limit-loss").inner_text() == f"limit loss {over:.4f} (L1), {over**2:.4f} (L2)"
    )
    slider(tab, "thumb_tip_rot_z").fill("20")
    assert "beyond" not in thumb.get_attribute("class")
    assert tab.locator("#limit-loss").inner_text() == "limit loss 0.0000 (L1), 0.0000 (L2)"


def test_a_pose_is_pasted(visit: Visit, bare: Path, rng: np.random.Generator) -> None:
    """A list from Python, or the angles of a hand in JSON."""
    tab = visit(bare)
    inputs = np.round(rng.normal(0, 0.5, 47), 4)
    tab.locator("#pose").fill(f"inputs = np.array({inputs.tolist()})")
    assert_allclose(joints_in(tab)[:, 3:], Kinematics(HAND).joints(inputs[None])[0], atol=6e-5)
    angles = {
        name: value for name, value in zip(HAND.dof_names, HAND.theta(inputs)) if "rot" in name
    }
    tab.locator("#pose").fill(f"[{', '.join('0' * 47)}]")
    tab.locator("#pose").fill(json.dumps({"hands": [{"angles_rad": angles, "crop": {}}]}, indent=2))
    inputs[:3] = 0
    assert_allclose(joints_in(tab)[:, 3:], Kinematics(HAND).joints(inputs[None])[0], atol=6e-5)
    assert tab.locator("#pose-error").inner_text() == ""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[1, 2, 3]", "found 3 numbers; skeleton 'nyu' has 47 inputs"),
        ("a pose", "'a' is not a number; expected 47 inputs"),
        ("[" * 50_000, f"'{'[' * 40}' is not a number; expected 47 inputs"),
        ("1e308 " * 47, "palm_x: found 1e+308; expected a number up to 1000000"),
        (
            '{"angles_rad": {"nose": 1}}',
            "unknown DoF 'nose'; skeleton 'nyu' has palm_x, palm_y, palm_z ...",
        ),
        ('{"angles_rad": {"palm_y": "x"}}', "palm_y: found NaN; expected a number up to 1000000"),
        ('{"angles_rad": {1}}', "angles_rad is not complete JSON"),
    ],
    ids=range(7),
)
def test_an_invalid_pose_is_rejected(tab: Any, text: str, line: str) -> None:
    tab.locator("#pose").fill(text)
    assert tab.locator("#pose-error").inner_text() == line
    assert tab.evaluate("hand.body.inputs.every((value) => value === 0)")


# -------------------------------------------------------------------------------------- the picture


def test_the_mouse_and_the_keyboard_rotate_the_picture(visit: Visit, bare: Path) -> None:
    """Dragging rotates, the wheel zooms, a double click resets; the joints do not move."""
    tab = visit(bare)
    state = "JSON.stringify([hand.view.camera.orientation, hand.view.camera.zoom])"
    first, table = tab.evaluate(state), joints_in(tab)
    box = tab.locator("#view").bounding_box()
    tab.mouse.move(box["x"] + 20, box["y"] + 20)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 60, box["y"] + 50, steps=3)
    tab.mouse.up()
    nearer = "(([x, y, z]) => hand.view.camera.project([x, y, z - 50]))(hand.view.camera.center)"
    u, v, _ = tab.evaluate(nearer)
    assert u > box["width"] / 2 + 5
    assert v > box["height"] / 2 + 5
    tab.dispatch_event("#view", "wheel", {"deltaY": -200})
    assert tab.evaluate("hand.view.camera.zoom") > 1.2
    tab.mouse.dblclick(box["x"] + 20, box["y"] + 20)
    assert tab.evaluate(state) == first
    tab.locator("#view").press("ArrowRight")
    tab.locator("#view").press("-")
    assert tab.evaluate(state) != first and tab.evaluate("hand.view.camera.zoom") < 1
    tab.locator("#view").press("0")
    assert tab.evaluate(state) == first
    assert_array_equal(joints_in(tab), table)


def test_the_surface_is_drawn_where_it_is(visit: Visit, bare: Path) -> None:
    """The surface is drawn, and without it only lines; the name of the joint under the
    mouse is shown.
    """
    tab = visit(bare)
    assert 0.05 < (colours(tab)[:, 3] == 255).mean() < 0.5
    tab.get_by_label("surface", exact=True).uncheck()
    assert 0.001 < (colours(tab)[:, 3] == 255).mean() < 0.03
    tab.get_by_label("skeleton", exact=True).uncheck()
    axes = (colours(tab)[:, 3] > 0).sum()  # axes and scale bar alone
    assert 0 < axes < 4000
    tab.mouse.move(*position(tab, HAND.joint_names.index("index_tip")))
    assert re.fullmatch(r"index_tip: 69\.2, 125\.4, 643\.2 mm", tab.locator("#hover").inner_text())
    assert (colours(tab)[:, 3] > 0).sum() > axes + 1000  # the joint's name
    slider(tab, "index_pip_rot_x").fill("-45")
    # the tip has moved
    assert not tab.locator("#hover").inner_text().startswith("index_tip: 69.2, 125.4")
    tab.get_by_role("button", name="Start again").click()
    assert tab.locator("#hover").inner_text() == ""


def test_an_address_sets_body_pose_and_force(visit: Visit, packaged: Path) -> None:
    """An address as in chapters 8 and 9 sets their arm, its wrist at (3, 6), and torques of 0
    and -300 N mm.
    """
    tab = visit(
        packaged,
        fragment="body=arm&shoulder=53.13&elbow=36.87&force=wrist,1,2,0&nose=1&force=wrist,2",
    )
    assert_allclose(joints_in(tab)[:, 3:], [[3, 4, 0], [3, 6, 0]], atol=1e-4)
    assert tab.locator(".torque").all_inner_texts() == ["0.0 N mm", "-300 N mm"]
    assert tab.locator("#bodies").input_value() == "arm"


def test_a_force_is_dragged_at_a_fingertip(visit: Visit, bare: Path) -> None:
    """A force is dragged in the picture's plane, in proportion; the bars show torques; other joints
    must be enabled.
    """
    tab, j = visit(bare), HAND.joint_names.index("ring_tip")
    x, y = position(tab, j)
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 40, y + 25, steps=2)
    tab.mouse.up()
    depth = tab.evaluate(f"hand.view.camera.project(hand.body.joints[{j}])[2]")
    focal, radius = tab.evaluate("[hand.view.camera.focal, hand.view.camera.radius]")
    force = np.array([40, -25, 0]) * depth / focal / (radius / 32)
    assert_allclose(tab.evaluate(f"hand.body.forces[{j}]"), force, atol=0.05)
    assert [float(tab.locator(f"#force-{axis}").input_value()) for axis in "xyz"] == pytest.approx(
        force, abs=0.05
    )
    for name, unit in (("palm_y", "N"), ("ring_base_rot_x", "N mm"), ("palm_rot_z", "N mm")):
        number, _, shown = row(tab, name).locator(".torque").inner_text().partition(" ")
        # test_numbers.py compares them
        torque = tab.evaluate(f"hand.body.torques[{HAND.dof_names.index(name)}]")
        assert shown == unit
        assert float(number) == pytest.approx(torque, abs=0.05 if abs(torque) < 100 else 0.5)
    assert row(tab, "index_pip_rot_x").locator(".torque").inner_text() == ""
    tab.get_by_role("button", name="No force").click()
    assert not np.any(tab.evaluate("hand.body.forces"))
    palm = HAND.joint_names.index("palm")
    for anywhere in (False, True):
        tab.get_by_label("drag any joint").set_checked(anywhere)
        tab.evaluate("scrollTo(0, 0)")
        x, y = position(tab, palm)
        tab.mouse.move(x, y)
        tab.mouse.down()
        tab.mouse.move(x + 30, y)
        tab.mouse.up()
        assert np.any(tab.evaluate(f"hand.body.forces[{palm}]")) == anywhere


# ---------------------------------------------------------------------------------- predicted hands

UVD, CUBE = np.array([230.0, 190, 640]), 260.0


@pytest.fixture(scope="module")
def predicted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A page with a right and a left hand, as seen by a camera, and the left one's
    joints (K, 3) in mm.
    """
    model, center = CapsuleModel(HAND, CUBE / 2), KINECT2.unproject(UVD)
    x = model.variables_of(np.random.default_rng(5).uniform(-0.2, 0.2, (1, 47)))
    x[0, -2:] = 0.08, -0.05
    hands = []
    for side, flip in (("right", 1), ("left", -1)):
        surface, mirror = model.capsules(x, np.zeros((1, 3))), np.array([flip, 1, 1])
        seen = surface._replace(a=surface.a * mirror + center, b=surface.b * mirror + center)
        crop = normalise_depth(render_crop(seen, UVD[None], CUBE, KINECT2), UVD[2:], CUBE)[0]
        hands.append(
            hand(
                f"{side}.png",
                f"{side} hand, 90% sure",
                model.whole_inputs_of(x)[0],
                camera=KINECT2,
                center_uvd=UVD,
                cube_mm=CUBE,
                crop=crop,
                size=float(np.exp(x[0, -2])),
                thickness=float(np.exp(x[0, -1])),
                side=side,
            )
        )
    out = tmp_path_factory.mktemp("predicted") / "predicted.html"
    out.write_text(page("Hands", [body("hand", HAND)], hands), encoding="utf-8")
    return out, model.joints(x)[0] * (-1, 1, 1) + center


def test_predicted_hands(visit: Visit, predicted: tuple[Path, np.ndarray]) -> None:
    path, joints = predicted
    tab = visit(path)
    assert tab.locator("#description").inner_text() == "right hand, 90% sure"
    tab.locator("#hands").select_option("left.png")
    assert tab.locator("#description").inner_text() == "left hand, 90% sure"
    assert tab.get_by_label("left hand").is_checked()
    assert_allclose(joints_in(tab)[:, :3], joints, atol=0.06)
    tab.evaluate(
        "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
    drawn, recorded = (picture(tab, name)[..., 0].astype(int) for name in ("depth", "recorded"))
    assert (recorded > 0).mean() > 0.1
    assert (np.abs(drawn - recorded) > 1).mean() < 0.002
    with_points = colours(tab)
    tab.get_by_label("depth points").uncheck()
    blue = [
        (shown[:, 2].astype(int) > shown[:, 0].astype(int) + 60).mean()
        for shown in (with_points, colours(tab))
    ]
    assert blue[0] > blue[1] + 0.01
    tab.get_by_label("left hand").uncheck()
    mirrored = (joints[:, 0] - KINECT2.unproject(UVD)[0]) / (CUBE / 2)
    assert_allclose(joints_in(tab)[:, 3], -mirrored, atol=1e-3)
    tab.get_by_role("button", name="Start again").click()
    assert_allclose(joints_in(tab)[:, :3], joints, atol=0.06)


# ----------------------------------------------------------------------------------- names, screens


def test_names_are_text_and_no_markup(visit: Visit, tmp_path: Path) -> None:
    """Names in an untrusted skeleton are shown as text; names of properties of every object are
    drawn like others.
    """
    evil = '<img src=\\"x\\" onerror=\\"document.title=1\\">'
    text = (
        ARM.replace('"hand"', f'"{evil}"')
        .replace('"elbow"', '"__proto__"')
        .replace('"arm"', f'"{evil}"')
    )
    skeleton = skeleton_of(text.replace('"other"', '"constructor"'))
    out = tmp_path / "evil.html"
    out.write_text(page("<b>&", [body("</script><img src=x>", skeleton)]), encoding="utf-8")
    tab = visit(out)
    assert tab.title() == "<b>&" and not tab.locator("img, b").count()
    assert tab.locator("#name").inner_text().startswith('<img src="x" onerror')
    assert (
        tab.evaluate("hand.body.skeleton.joints[0]") == '<img src="x" onerror="document.title=1">'
    )
    assert (colours(tab)[:, 3] == 255).mean() > 1e-4


def test_the_page_blocks_other_scripts_and_requests(browser: Any, bare: Path) -> None:
    tab = browser.new_page()
    console = []
    tab.on("console", lambda message: console.append(message.text))
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
    assert sum("Content Security Policy" in line for line in console) >= 2
