"""Figures of chapters 0, 7 and 10: what a network predicts for frames that are rendered here."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from docs.making.figures.drawing import DEPTH, FIRST, SECOND, THIRD, new_figure
from handpose import NYU
from handpose.body.nyu import CUBE_MM
from handpose.estimate.nets import skeleton_to_fit
from handpose.estimate.packaged import PAPER_HAND
from handpose.frames.crops import crop_pixels, restore_joints
from handpose.output.drawing import hands
from handpose.synthetic.generator import BLOCK, Generator, Split
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.blob import Array, divide_up
from netlib.net import Net
from netlib.training.trained import trained

HALF_CUBE_MM = CUBE_MM / 2
ROW = 64  # of the crop, whose profile is drawn


class Frames(NamedTuple):
    """Crops (N, 1, 128, 128), their centres (N, 3), the joints (N, 31, 3) in half-cubes and the
    inputs (N, 47) of the hands.
    """

    depth: Array
    center_uvd: Array
    joints: Array
    inputs: Array


def rendered(split: Split, count: int) -> Frames:
    """The first frames of a split."""
    generator = Generator(seed=0, split=split)
    blocks = list(map(generator.block, range(divide_up(count, BLOCK))))

    def joined(name: str) -> Array:
        return np.concatenate([getattr(block, name) for block in blocks])[:count]

    joints = joined("joint").reshape(-1, 31, 3)
    return Frames(joined("depth"), joined("center_uvd"), joints, joined("dof"))


class Predictions(NamedTuple):
    """Held-out frames, and the joints (N, 31, 3) in half-cubes and inputs (N, 47) that the packaged
    network predicts.
    """

    frames: Frames
    joints: Array
    inputs: Array
    skeleton: Skeleton


@functools.cache
def predictions() -> Predictions:
    """Predictions for 256 frames."""
    frames = rendered("test", 256)
    net = trained(PAPER_HAND / "deploy.prototxt", PAPER_HAND / "paper_hand.caffemodel.h5")
    joints = joints_of(net, frames.depth)
    inputs = net.blobs["DoF"].data.copy()
    return Predictions(frames, joints, inputs, skeleton_to_fit(net))


def joints_of(net: Net, depth: Array) -> Array:
    """The joints (N, 31, 3) that a network predicts for crops (N, 1, 128, 128)."""
    net.blobs["depth"].reshape(*depth.shape)
    return net.forward(depth=depth)["pred"].reshape(-1, 31, 3).copy()


def crop() -> Any:
    """A crop, and the numbers along one of its rows, in half-cubes and in mm."""
    frames = predictions().frames
    depth = frames.depth[0, 0]
    figure = new_figure(8.5, 3.6)
    picture, profile = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1, 1.6)})
    picture.imshow(depth, cmap=DEPTH, vmin=-1, vmax=1)
    picture.axhline(ROW, color=SECOND, lw=1)
    picture.set_title("a crop, near is light")
    profile.plot(depth[ROW], color=SECOND, lw=1.2)
    profile.set(
        ylim=(1.1, -1.1), xlabel="column", ylabel="value in the crop", title=f"its row {ROW}"
    )
    profile.grid(alpha=0.3)
    middle = float(frames.center_uvd[0, 2])

    def depth_of(value: Array) -> Array:
        return middle + HALF_CUBE_MM * value

    def value_of(depth_mm: Array) -> Array:
        return (depth_mm - middle) / HALF_CUBE_MM

    scale = profile.secondary_yaxis("right", functions=(depth_of, value_of))
    scale.set_ylabel("depth, mm")
    return figure


def six_hands() -> Any:
    """The first six held-out frames: the predicted skeleton in colours, the true one in white."""
    found = predictions()
    figure = new_figure(8.5, 6.0)
    for n, axes in enumerate(figure.subplots(2, 3).flat):
        draw_hands(axes, found.frames, n, found.joints[n], found.skeleton)
        error = error_mm(found.joints[n], found.frames.joints[n])
        axes.set_title(f"frame {n}: {error:.0f} mm", fontsize=9)
        axes.set_axis_off()
    return figure


def error_mm(joints: Array, truth: Array) -> float:
    """The mean distance of joints (..., 31, 3) in half-cubes."""
    return float(HALF_CUBE_MM * np.linalg.norm(joints - truth, axis=-1).mean())


def draw_hands(axes: Any, frames: Frames, n: int, predicted: Array, skeleton: Skeleton) -> None:
    """Draw the crop of frame ``n``, its true joints in white and the predicted ones (31, 3) in
    colours.
    """
    axes.imshow(0.8 * (1 - frames.depth[n, 0]) / 2, cmap="gray", vmin=0, vmax=1)
    center = np.asarray(frames.center_uvd[n], dtype=np.float64)[None]
    colours = joint_colours(skeleton)
    white = ["white"] * len(colours)
    for joints, colour_of, width in ((frames.joints[n], white, 1), (predicted, colours, 2)):
        xyz = restore_joints(joints[None], NYU.unproject(center), HALF_CUBE_MM)
        pixels = crop_pixels(NYU.project(xyz), center, CUBE_MM)[0]
        for parent, joint in hands.bones(skeleton):
            axes.plot(*pixels[[parent, joint]].T, color=colour_of[joint], lw=width)


def joint_colours(skeleton: Skeleton) -> list[tuple[float, ...]]:
    """Each joint's colour in matplotlib's form: red, green, blue, up to 1."""
    return [tuple(channel / 255 for channel in reversed(bgr)) for bgr in hands.colours(skeleton)]


def joint_errors() -> Any:
    """The mean error of each joint; and how far a finger is bent, in truth and by the network."""
    found = predictions()
    figure = new_figure(8.5, 4.4)
    bars, bent = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.5, 1)})
    distances = np.linalg.norm(found.joints - found.frames.joints, axis=2)
    errors = distances.mean(axis=0) * HALF_CUBE_MM
    order = np.argsort(errors)
    colours = joint_colours(found.skeleton)
    places = np.arange(len(order))
    bars.barh(places, errors[order], color=[colours[j] for j in order])
    bars.set_yticks(places, [found.skeleton.joint_names[j] for j in order], fontsize=6)
    bars.set(xlabel="mean error, mm", title=f"{len(found.joints)} held-out frames")
    dof = found.skeleton.dof_names.index("middle_dip_rot_x")
    bent.plot([-1.5, 0.6], [-1.5, 0.6], color="0.6", lw=1)
    bent.plot(found.frames.inputs[:, dof], found.inputs[:, dof], ".", color=THIRD, ms=3)
    bent.set(xlabel="true, rad", ylabel="predicted, rad", title="middle_dip_rot_x")
    bent.grid(alpha=0.3)
    return figure


class Progress(NamedTuple):
    """A network after some iterations: mean errors in mm, and its joints (N, 31, 3), in half-cubes,
    for the frames to be drawn.
    """

    iteration: int
    training_mm: float
    held_out_mm: float
    joints: Array


def hands_over_time(course: list[Progress], frames: Frames, drawn: list[int]) -> Any:
    """Chapter 0: held-out hands before training, after a tenth of the iterations and at the end.

    ``drawn`` are the numbers of the frames whose joints the course has.
    """
    last = course[-1].iteration
    shown = [state for state in course if state.iteration in (0, last // 10, last)]
    figure = new_figure(8.5, 2.3 * len(shown))
    for row, state in zip(figure.subplots(len(shown), len(drawn), squeeze=False), shown):
        row[0].set_ylabel(f"{state.iteration} iterations\n{state.held_out_mm:.0f} mm", fontsize=9)
        for axes, n, joints in zip(row, drawn, state.joints):
            draw_hands(axes, frames, n, joints, skeletons.load())
            axes.set(xlim=(0, 127), ylim=(127, 0), xticks=[], yticks=[])
    return figure


def errors_over_time(runs: dict[int, list[Progress]]) -> Any:
    """Chapter 7: the errors of runs on their training frames and on held-out frames, by the
    number of frames.
    """
    figure = new_figure(8.5, 3.2)
    for axes, (count, course) in zip(figure.subplots(1, 2, sharey=True), runs.items()):
        iterations, training_mm, held_out_mm, _ = zip(*course)
        axes.plot(iterations, held_out_mm, "s--", color=SECOND, ms=3, label="held-out frames")
        axes.plot(iterations, training_mm, "o-", color=FIRST, ms=3, label="training frames")
        axes.set(title=f"{count:,} training frames", xlabel="iteration", ylim=(0, 105))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("mean error, mm")
    figure.axes[0].legend(fontsize=8)
    return figure
