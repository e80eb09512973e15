"""Figures of chapters 8 and 9: the planar arm, the joints of the hand, a force and its torques."""

from __future__ import annotations

from typing import Any

import numpy as np

from docs.making.figures.drawing import AXES, FINGERS, FORCE, INK, LINE, PALM, new_figure
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import load
from netlib.blob import Array

# With these angles, the elbow is at (3, 4) and the wrist at (3, 6).
SHOULDER = np.arctan2(4, 3)
ELBOW = np.pi / 2 - SHOULDER
BONES = (5.0, 2.0)
HALF_CUBE_MM = 150


def arm_joints(theta: Array) -> Array:
    """Shoulder, elbow and wrist (3, 2) of the arm of chapter 8, for its two angles in rad."""
    turns = np.cumsum(theta)
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    steps = directions * np.array(BONES)[:, None]
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def arm_torques(joints: Array, force: Array) -> Array:
    """The torques (2,) of a force on the wrist about shoulder and elbow."""
    levers = joints[2] - joints[:2]
    return np.array([x * force[1] - y * force[0] for x, y in levers])


ARM = arm_joints(np.array([SHOULDER, ELBOW]))


def arm() -> Any:
    """The arm of chapter 8 with the frame of each joint."""
    figure, axes = _plane(5.2, 4.6)
    _bones(axes, ARM)
    turns = (0.0, SHOULDER, SHOULDER + ELBOW)
    for place, turn, name in zip(ARM, turns, ("shoulder", "elbow", "wrist")):
        for axis, colour in ((0.0, AXES[0]), (np.pi / 2, AXES[1])):
            _arrow(axes, place, place + 1.1 * _direction(turn + axis), colour, 1.6)
        x, y = place
        label = x + 0.25, y + (0.15 if name == "wrist" else -0.45)
        axes.text(*label, f"{name} ({x:g}, {y:g})", fontsize=9)
    angles = (SHOULDER, "53.13°"), (ELBOW, "+ 36.87°")
    for place, begin, (turn, words) in zip(ARM, turns, angles):
        _arc(axes, place, 1.5, begin, begin + turn, INK)
        label = place + 1.7 * _direction(begin + turn / 2)
        axes.text(*label, words, fontsize=8, color=INK, va="center")
    axes.plot(*np.array([ARM[1], 1.3 * ARM[1]]).T, ":", color=LINE, lw=1)
    axes.set(xlim=(-1.2, 6.2), ylim=(-1.0, 7.6))
    axes.set_title("bones 5 and 2; the frame of each joint, x red and y green", fontsize=10)
    return figure


def lever() -> Any:
    """A force on the wrist of that arm, and its lever about either joint."""
    figure, axes = _plane(5.2, 4.6)
    wrist = ARM[2]
    force = np.array([1.0, 2.0])
    _bones(axes, ARM)
    _arrow(axes, wrist, wrist + force, FORCE, 2)
    axes.text(*(wrist + force + (0.15, -0.1)), "f = (1, 2)", color=FORCE)
    shifts = (0.0, -0.18)  # the elbow's lever is beside its bone
    for pivot, name, torque, shift in zip(
        ARM, ("shoulder", "elbow"), arm_torques(ARM, force), shifts
    ):
        lever = np.array([pivot, wrist]) + (shift, 0)
        axes.plot(*lever.T, "--", color=INK, lw=1)
        if abs(torque) > 1e-9:
            arc = _arc(axes, pivot, 0.8, 2.4, 2.4 + np.sign(torque) * 1.8, FORCE)
            _arrow(axes, arc[-3], arc[-1], FORCE, 1.6)
        x, y, torque = np.round([*(wrist - pivot), torque], 6) + 0.0  # turns -0 into 0
        words = f"{name}: lever ({x:g}, {y:g})\ntorque {torque:g}"
        axes.text(*(pivot + (0.35, -0.55)), words, fontsize=9)
    axes.set(xlim=(-1.2, 6.8), ylim=(-1.2, 8.6), title="torque = lever × force")
    return figure


def reach() -> Any:
    """The arm of chapter 8 led to a target by its own torques: poses after some steps of
    gradient descent.
    """
    figure, axes = _plane(5.2, 4.2)
    target = np.array([-3.0, 5.0])
    theta = np.array([SHOULDER, ELBOW])
    shown = (0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 100)
    for step in range(max(shown) + 1):
        joints = arm_joints(theta)
        if step in shown:
            axes.plot(*joints.T, "o-", color=str(0.85 - 0.075 * shown.index(step)), ms=4, lw=2)
        theta = theta - 0.01 * arm_torques(joints, joints[2] - target)
    axes.plot(*target, "x", color=FORCE, ms=10, mew=2)
    axes.set(xlim=(-4.2, 4.2), ylim=(-0.6, 7.4))
    axes.set_title(f"after {', '.join(map(str, shown))} steps", fontsize=10)
    return figure


def hand_joints() -> Any:
    """The 31 joints of the hand in its initial pose, from the front and from the side,
    with their names.
    """
    hand = load()
    xyz = HALF_CUBE_MM * Kinematics(hand).joints(np.zeros((1, 47)))[0]
    figure = new_figure(10, 6.2)
    front, side, names = figure.subplots(1, 3, gridspec_kw={"width_ratios": (4.4, 2.6, 2.2)})
    views = (front, 0, "x, mm", "from the camera"), (side, 2, "z, mm (away)", "from the side")
    for axes, across, xlabel, title in views:
        points = xyz[:, [across, 1]]
        number_style = {"fontsize": 6.5, "ha": "center", "va": "center_baseline", "zorder": 3}
        for j, (name, parent) in enumerate(zip(hand.joint_names, hand.parents)):
            if parent >= 0:
                axes.plot(*points[[parent, j]].T, color=_colour(name), lw=2, zorder=1)
            axes.plot(*points[j], "o", ms=11, color=_colour(name), mec="white", zorder=2)
            axes.text(*points[j], str(j), color="white", **number_style)
        axes.set(xlabel=xlabel, ylabel="y, mm", title=title, aspect="equal")
        axes.grid(alpha=0.25)
    names.axis("off")
    for j, name in enumerate(hand.joint_names):
        height = 1 - j / len(hand.joint_names)
        line = f"{j:2d}  {name}"
        names.text(0, height, line, fontsize=8, family="monospace", color=_colour(name), va="top")
    return figure


def _colour(name: str) -> str:
    """The colour of a joint: its finger's, or the palm's."""
    finger = name.partition("_")[0]
    return PALM if name.endswith("_mcp") and finger != "thumb" else FINGERS.get(finger, PALM)


def _direction(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def _arrow(axes: Any, start: Array, end: Array, colour: str, width: float) -> None:
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": width})


def _arc(axes: Any, place: Array, radius: float, begin: float, end: float, colour: str) -> Array:
    """Draw an arc; returns its points."""
    points = place + radius * np.array([_direction(angle) for angle in np.linspace(begin, end, 30)])
    axes.plot(*points.T, color=colour, lw=1.2)
    return points


def _plane(width: float, height: float) -> tuple[Any, Any]:
    figure = new_figure(width, height)
    axes = figure.add_subplot()
    axes.set(aspect="equal", xlabel="x", ylabel="y")
    axes.grid(alpha=0.25)
    return figure, axes


def _bones(axes: Any, joints: Array) -> None:
    axes.plot(*joints.T, color=LINE, lw=5, solid_capstyle="round", zorder=0)
    axes.plot(*joints.T, "o", color=INK, ms=6)
