"""Figures of chapters 8 and 9 (the planar arm, the joints of the hand, a force and its torques), and joint angles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from docs.making.figures.drawn import new_figure
from docs.making.palette import AXES, FINGERS, FORCE, INK, LINE, PALM
from handpose.body.joint_formats.frames import HandFrames, frames_of
from handpose.body.joint_formats.points import POINTS, weights_of
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton, load
from netlib.blob import Array

SHOULDER, ELBOW = np.arctan2(4, 3), np.pi / 2 - np.arctan2(4, 3)  # they lead the arm to (3, 4) and (3, 6)
BONES = (5.0, 2.0)
HALF_CUBE = 150.0


def arm_joints(theta: Sequence[float] | Array = (SHOULDER, ELBOW)) -> Array:
    """Shoulder, elbow and wrist (3, 2) of the arm of chapter 8."""
    turns = np.cumsum(theta)
    steps = np.stack([np.cos(turns), np.sin(turns)], axis=1) * np.array(BONES)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def arm_torques(places: Array, force: Array) -> list[float]:
    """What a force on the wrist does to the shoulder and to the elbow."""
    levers = places[2] - places[:2]
    return [float(x * force[1] - y * force[0]) for x, y in levers]


def arm() -> Any:
    """The arm of chapter 8 with the frame of each joint."""
    figure = new_figure(5.2, 4.6)
    axes = _plane(figure)
    places = arm_joints()
    _bones(axes, places)
    for place, turn, name in zip(places, (0.0, SHOULDER, SHOULDER + ELBOW), ("shoulder", "elbow", "wrist")):
        for axis, colour in ((0.0, AXES[0]), (np.pi / 2, AXES[1])):
            tip = place + 1.1 * np.array([np.cos(turn + axis), np.sin(turn + axis)])
            axes.annotate("", tip, place, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6})
        aside = (0.25, 0.15) if name == "wrist" else (0.25, -0.45)
        axes.text(*(place + aside), f"{name} ({place[0]:g}, {place[1]:g})", fontsize=9)
    for place, begin, turn, words in zip(places, (0.0, SHOULDER), (SHOULDER, ELBOW), ("53.13°", "+ 36.87°")):
        _arc(axes, place, 1.5, begin, begin + turn, INK)
        middle = place + 1.7 * np.array([np.cos(begin + turn / 2), np.sin(begin + turn / 2)])
        axes.text(*middle, words, fontsize=8, color=INK, va="center")
    axes.plot(*np.array([places[1], places[1] + 1.5 * (places[1] / 5)]).T, ":", color=LINE, lw=1)
    axes.set(xlim=(-1.2, 6.2), ylim=(-1.0, 7.6))
    axes.set_title("bones 5 and 2; the frame of each joint, x red and y green", fontsize=10)
    return figure


def lever() -> Any:
    """A force on the wrist of that arm, and its lever about either joint."""
    figure = new_figure(5.2, 4.6)
    axes = _plane(figure)
    places, force = arm_joints(), np.array([1.0, 2.0])
    _bones(axes, places)
    wrist = places[2]
    axes.annotate("", wrist + force, wrist, arrowprops={"arrowstyle": "->", "color": FORCE, "lw": 2})
    axes.text(*(wrist + force + (0.15, -0.1)), "f = (1, 2)", color=FORCE)
    for pivot, name, torque, aside in zip(places, ("shoulder", "elbow"), arm_torques(places, force), (0.0, -0.18)):
        axes.plot(*(np.array([pivot, wrist]) + (aside, 0)).T, "--", color=INK, lw=1)  # the elbow's is on the bone
        if abs(torque) > 1e-9:
            _arc(axes, pivot, 0.8, 2.4, 2.4 + np.sign(torque) * 1.8, FORCE, arrow=True)
        x, y = np.round(wrist - pivot, 6) + 0.0
        label = f"{name}: lever ({x:g}, {y:g})\ntorque {round(torque, 6) + 0.0:g}"
        axes.text(*(pivot + (0.35, -0.55)), label, fontsize=9)
    axes.set(xlim=(-1.2, 6.8), ylim=(-1.2, 8.6), title="torque = lever × force")
    return figure


def reach() -> Any:
    """The arm of chapter 8 led to a target by its own torques: poses after some steps of gradient descent."""
    figure = new_figure(5.2, 4.2)
    axes = _plane(figure)
    target, theta = np.array([-3.0, 5.0]), np.array([SHOULDER, ELBOW])
    shown = (0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 100)
    for step in range(max(shown) + 1):
        places = arm_joints(theta)
        if step in shown:
            shade = str(0.85 - 0.075 * shown.index(step))
            axes.plot(*places.T, "o-", color=shade, ms=4, lw=2)
        theta = theta - 0.01 * np.array(arm_torques(places, places[2] - target))
    axes.plot(*target, "x", color=FORCE, ms=10, mew=2)
    axes.set(xlim=(-4.2, 4.2), ylim=(-0.6, 7.4))
    axes.set_title(f"after {', '.join(map(str, shown))} steps", fontsize=10)
    return figure


def joints() -> Any:
    """The 31 joints of the hand in its initial pose, from the front and from the side, with their names."""
    hand = load()
    xyz = HALF_CUBE * Kinematics(hand).joints(np.zeros((1, 47)))[0]
    figure = new_figure(10, 6.2)
    grid = figure.add_gridspec(1, 3, width_ratios=(4.4, 2.6, 2.2))
    views = ((0, 1, "x, mm", "y, mm", "from the camera"), (2, 1, "z, mm (away)", "y, mm", "from the side"))
    for column, (across, up, xlabel, ylabel, title) in enumerate(views):
        axes = figure.add_subplot(grid[column])
        for j, parent in enumerate(hand.parents):
            if parent >= 0:
                axes.plot(*xyz[[parent, j]][:, [across, up]].T, color=_colour(hand.joint_names[j]), lw=2, zorder=1)
        for j, name in enumerate(hand.joint_names):
            axes.plot(*xyz[j, [across, up]], "o", ms=11, color=_colour(name), mec="white", zorder=2)
            place = {"ha": "center", "va": "center_baseline", "color": "white", "zorder": 3}
            axes.text(*xyz[j, [across, up]], str(j), fontsize=6.5, **place)
        axes.set(xlabel=xlabel, ylabel=ylabel, title=title, aspect="equal")
        axes.grid(alpha=0.25)
    names = figure.add_subplot(grid[2])
    names.axis("off")
    for j, name in enumerate(hand.joint_names):
        names.text(0, 1 - j / 31, f"{j:2d}  {name}", fontsize=8, family="monospace", color=_colour(name), va="top")
    return figure


def _colour(name: str) -> str:
    finger = name.split("_", maxsplit=1)[0]
    return PALM if name.endswith("_mcp") and finger != "thumb" else FINGERS.get(finger, PALM)


def _arc(axes: Any, place: Array, radius: float, begin: float, end: float, colour: str, arrow: bool = False) -> None:
    angles = np.linspace(begin, end, 30)
    points = place + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    axes.plot(*points.T, color=colour, lw=1.2)
    if arrow:
        axes.annotate("", points[-1], points[-3], arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.6})


def _plane(figure: Any) -> Any:
    axes = figure.add_subplot()
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    axes.grid(alpha=0.25)
    return axes


def _bones(axes: Any, places: Array) -> None:
    axes.plot(*places.T, color=LINE, lw=5, solid_capstyle="round", zorder=0)
    axes.plot(*places.T, "o", color=INK, ms=6)
    axes.plot(*places.T, color=LINE, lw=5, solid_capstyle="round", zorder=0)
    axes.plot(*places.T, "o", color=INK, ms=6)


def joint_angles() -> Any:
    """What flexion and abduction mean: a finger from its side, and the back of the hand."""
    skeleton = load()
    joints = Kinematics(skeleton).joints(np.zeros((1, len(skeleton.initial))))[0] * HALF_CUBE
    frames = frames_of(skeleton, joints)
    figure = new_figure(9.6, 4.6)
    side, back = figure.subplots(1, 2)
    _flexion(side)
    _abduction(back, {name: weights @ joints for name, weights in _rows(skeleton).items()}, frames)
    for axes in (side, back):
        axes.set_aspect("equal")
        axes.axis("off")
    return figure


def _flexion(axes: Any) -> None:
    """A finger with the palm below: each bone, and how far it is bent against the one before."""
    bends = {"mcp_flexion": 35.0, "pip_flexion": 40.0, "dip_flexion": 25.0}
    places, turn = [np.zeros(2), np.array([60.0, 0.0])], 0.0
    for bend, length in zip(bends.values(), (42.0, 28.0, 22.0)):
        turn += np.radians(bend)
        places.append(places[-1] + length * np.array([np.cos(turn), -np.sin(turn)]))
    _bones(axes, np.array(places))
    for before, at, _after, (name, bend) in zip(places, places[1:], places[2:], bends.items()):
        on = (at - before) / np.linalg.norm(at - before)
        axes.plot(*np.array([at, at + 20 * on]).T, "--", color=LINE, lw=1)
        start, sweep = np.arctan2(on[1], on[0]), np.linspace(0, np.radians(bend), 20)
        arc = at + 16 * np.stack([np.cos(start - sweep), np.sin(start - sweep)], axis=1)
        axes.plot(*arc.T, color=FORCE, lw=1.5)
        axes.annotate("", arc[-1], arc[-4], arrowprops={"arrowstyle": "->", "color": FORCE})
        axes.text(*(at + 25 * on + (0, 2)), f"{name} +{bend:g}\u00b0", fontsize=9, color=FORCE)
    axes.text(2, 4, "metacarpal", fontsize=9)
    axes.text(2, -42, "palm below,\nback of the hand above", fontsize=8, color=PALM)
    axes.set(xlim=(-5, 175), ylim=(-95, 25), title="flexion, from the side")


def _rows(skeleton: Skeleton) -> dict[str, Array]:
    """Weights of each anatomical point."""
    return dict(zip(POINTS, weights_of(list(POINTS.values()), skeleton)))


def _abduction(axes: Any, points: dict[str, Array], frames: HandFrames) -> None:
    """A right hand seen from its back, in the plane of the palm: the thumb is at the left."""
    up, wrist = frames.palm["middle"], points["wrist"]

    def plane(at: Array) -> Array:
        return np.array([-(at - wrist) @ frames.radial, (at - wrist) @ up])

    for finger, colour in FINGERS.items():
        parts = ("cmc", "mcp", "ip", "tip") if finger == "thumb" else ("cmc", "mcp", "pip", "dip", "tip")
        places = np.array([plane(points[f"{finger}_{part}"]) for part in parts])
        axes.plot(*places.T, "o-", color=colour, lw=2, ms=4)
        if finger == "thumb":
            axes.annotate("", places[2] + (-30, -6), places[2], arrowprops={"arrowstyle": "->", "color": FORCE})
            axes.text(*(places[2] + (-78, -22)), "radial_abduction +", fontsize=8, color=FORCE)
            continue
        on = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
        axes.plot(*np.array([places[1], places[1] + 95 * on]).T, "--", color=LINE, lw=1)
        side = np.array([on[1], -on[0]]) * (1 if finger in ("ring", "little") else -1)
        axes.annotate("", places[1] + 95 * on + 16 * side, places[1] + 95 * on,
                      arrowprops={"arrowstyle": "->", "color": FORCE})
        axes.text(*(places[1] + 103 * on), finger, ha="center", fontsize=9, color=colour)
    axes.set(xlim=(-150, 115), ylim=(-10, 220), title="mcp_abduction, from the back of a right hand")
