"""Figures of chapter 10: what the packaged weights see in frames that are rendered here."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from docs.making.figures.drawn import new_figure
from docs.making.palette import DEPTH, FIRST, SECOND, THIRD
from handpose import NYU
from handpose.body.nyu import CUBE_MM
from handpose.estimate.nets import skeleton_to_fit, trained
from handpose.estimate.packaged import PAPER_HAND
from handpose.frames.crops import crop_pixels, restore_joints
from handpose.output.drawing.hands import bones, colours
from handpose.synthetic.generator import Generator
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

BLOCKS = 4  # of 64 frames
SHOWN = 6
ROW = 64  # of the crop, whose profile is shown
FLEXION = "middle_dip_rot_x"


class Seen(NamedTuple):
    """Held-out frames and what the network says of them; joints (N, 31, 3) in half-cubes."""

    depth: Array
    center_uvd: Array
    truth: Array
    joints: Array
    true_inputs: Array
    inputs: Array
    skeleton: Skeleton


@functools.cache
def seen() -> Seen:
    """Rendered and predicted once."""
    generator = Generator(seed=0, split="test")
    frames = [generator.block(number) for number in range(BLOCKS)]
    depth = np.concatenate([f.depth for f in frames])
    net = trained(PAPER_HAND / "deploy.prototxt", PAPER_HAND / "paper_hand.caffemodel.h5")
    net.blobs["depth"].reshape(*depth.shape)
    joints = net.forward(depth=depth)["pred"].reshape(-1, 31, 3).copy()
    return Seen(
        depth[:, 0],
        np.concatenate([f.center_uvd for f in frames]),
        np.concatenate([f.joint for f in frames]).reshape(-1, 31, 3),
        joints,
        np.concatenate([f.dof for f in frames if f.dof is not None]),
        net.blobs["DoF"].data.copy(),
        skeleton_to_fit(net),
    )


def joint_colours(skeleton: Skeleton) -> list[tuple[float, ...]]:
    """Each joint's colour as matplotlib has them: red, green, blue, up to 1."""
    return [tuple(channel / 255 for channel in reversed(colour)) for colour in colours(skeleton)]


def hinge() -> Any:
    """PhysLimit of one angle with limits −1 and 1, and its slope: linear and squared."""
    figure = new_figure(8.0, 3.2)
    x = np.linspace(-2, 2, 201)
    beyond = np.maximum(x - 1, 0) - np.maximum(-1 - x, 0)
    for axes, title, linear, squared in zip(
        figure.subplots(1, 2),
        ("the loss of one angle", "its slope"),
        (np.abs(beyond), np.sign(beyond)),
        (beyond**2, 2 * beyond),
    ):
        axes.axvspan(-1, 1, color="0.93")
        axes.plot(x, linear, color=FIRST, label="L1: linear, the paper's Eq. 2")
        axes.plot(x, squared, color=SECOND, ls="--", label="L2: squared, as released")
        axes.set_xlabel("angle (grey: within the limits)")
        axes.set_title(title)
        axes.grid(alpha=0.3)
    figure.axes[0].legend(fontsize=8)
    return figure


def crop() -> Any:
    """A crop, and the numbers along one of its rows, in half-cubes and in mm."""
    s = seen()
    figure = new_figure(8.5, 3.6)
    picture, profile = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1, 1.6)})
    picture.imshow(s.depth[0], cmap=DEPTH, vmin=-1, vmax=1)
    picture.axhline(ROW, color=SECOND, lw=1)
    picture.set_title("a crop, near is light")
    profile.plot(s.depth[0, ROW], color=SECOND, lw=1.2)
    profile.set_ylim(1.1, -1.1)
    profile.set_xlabel("column")
    profile.set_ylabel("value in the crop")
    profile.set_title(f"its row {ROW}")
    profile.grid(alpha=0.3)
    middle = float(s.center_uvd[0, 2])
    scale = profile.secondary_yaxis("right", functions=(lambda v: middle + 150 * v, lambda d: (d - middle) / 150))
    scale.set_ylabel("depth, mm")
    return figure


def six_hands() -> Any:
    """The first six held-out frames: the predicted skeleton in colours, the true one in white."""
    s = seen()
    figure = new_figure(8.5, 6.0)
    own = joint_colours(s.skeleton)
    for n, axes in enumerate(figure.subplots(2, 3).flat):
        axes.imshow(0.8 * (1 - s.depth[n]) / 2, cmap="gray", vmin=0, vmax=1)
        for joints, true in ((s.truth[n], True), (s.joints[n], False)):
            at = places(joints, s.center_uvd[n])
            for parent, joint in bones(s.skeleton):
                ends = at[[parent, joint]]
                axes.plot(ends[:, 0], ends[:, 1], color="white" if true else own[joint], lw=1 if true else 2)
        error = np.linalg.norm(s.joints[n] - s.truth[n], axis=1).mean() * CUBE_MM / 2
        axes.set_title(f"frame {n}: {error:.0f} mm", fontsize=9)
        axes.set_axis_off()
    return figure


def places(joints: Array, center_uvd: Array) -> Array:
    """Where the crop shows joints (31, 3) in half-cubes: (31, 2), column and row."""
    center = np.asarray(center_uvd, dtype=np.float64)[None]
    xyz = restore_joints(joints[None], NYU.unproject(center), CUBE_MM / 2)
    return np.asarray(crop_pixels(NYU.project(xyz), center, CUBE_MM)[0])


def joint_errors() -> Any:
    """The mean error of each joint; and how far a finger is bent, in truth and by the network."""
    s = seen()
    figure = new_figure(8.5, 4.4)
    bars, bent = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.5, 1)})
    errors = np.linalg.norm(s.joints - s.truth, axis=2).mean(axis=0) * CUBE_MM / 2
    order = np.argsort(errors)
    own = joint_colours(s.skeleton)
    bars.barh(np.arange(len(order)), errors[order], color=[own[j] for j in order])
    bars.set_yticks(np.arange(len(order)), [s.skeleton.joint_names[j] for j in order], fontsize=6)
    bars.set_xlabel("mean error, mm")
    bars.set_title(f"{len(s.joints)} held-out frames")
    dof = s.skeleton.dof_names.index(FLEXION)
    bent.plot([-1.5, 0.6], [-1.5, 0.6], color="0.6", lw=1)
    bent.plot(s.true_inputs[:, dof], s.inputs[:, dof], ".", color=THIRD, ms=3)
    bent.set_xlabel("true, rad")
    bent.set_ylabel("predicted, rad")
    bent.set_title(FLEXION)
    bent.grid(alpha=0.3)
    return figure
