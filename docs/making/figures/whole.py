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
from handpose.output.drawing.hands import bones, colours
from handpose.synthetic.generator import Generator
from layers.hand import skeleton as skeletons
from layers.hand.skeleton import Skeleton
from netlib.blob import Array
from netlib.training.trained import trained

HALF_CUBE_MM = CUBE_MM / 2
ROW = 64  # of the crop, whose profile is drawn


class Predictions(NamedTuple):
    """Held-out frames and the packaged network's predictions: joints (N, 31, 3) in half-cubes,
    inputs (N, 47).
    """

    depth: Array
    center_uvd: Array
    truth: Array
    joints: Array
    true_inputs: Array
    inputs: Array
    skeleton: Skeleton


@functools.cache
def predictions() -> Predictions:
    """Predictions for 256 frames."""
    generator = Generator(seed=0, split="test")
    frames = [generator.block(number) for number in range(4)]
    depth = np.concatenate([f.depth for f in frames])
    net = trained(PAPER_HAND / "deploy.prototxt", PAPER_HAND / "paper_hand.caffemodel.h5")
    net.blobs["depth"].reshape(*depth.shape)
    joints = net.forward(depth=depth)["pred"].reshape(-1, 31, 3).copy()
    centers, truth, inputs = (
        np.concatenate([getattr(f, name) for f in frames])
        for name in ("center_uvd", "joint", "dof")
    )
    predicted = net.blobs["DoF"].data.copy()
    return Predictions(
        depth[:, 0],
        centers,
        truth.reshape(-1, 31, 3),
        joints,
        inputs,
        predicted,
        skeleton_to_fit(net),
    )


def crop() -> Any:
    """A crop, and the numbers along one of its rows, in half-cubes and in mm."""
    found = predictions()
    figure = new_figure(8.5, 3.6)
    picture, profile = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1, 1.6)})
    picture.imshow(found.depth[0], cmap=DEPTH, vmin=-1, vmax=1)
    picture.axhline(ROW, color=SECOND, lw=1)
    picture.set_title("a crop, near is light")
    profile.plot(found.depth[0, ROW], color=SECOND, lw=1.2)
    profile.set(
        ylim=(1.1, -1.1), xlabel="column", ylabel="value in the crop", title=f"its row {ROW}"
    )
    profile.grid(alpha=0.3)
    middle = float(found.center_uvd[0, 2])

    def depth_of(value: Array) -> Array:
        return middle + HALF_CUBE_MM * value

    def value_of(depth: Array) -> Array:
        return (depth - middle) / HALF_CUBE_MM

    scale = profile.secondary_yaxis("right", functions=(depth_of, value_of))
    scale.set_ylabel("depth, mm")
    return figure


def six_hands() -> Any:
    """The first six held-out frames: the predicted skeleton in colours, the true one in white."""
    found = predictions()
    figure = new_figure(8.5, 6.0)
    for n, axes in enumerate(figure.subplots(2, 3).flat):
        draw_hands(
            axes,
            found.depth[n],
            found.center_uvd[n],
            found.truth[n],
            found.joints[n],
            found.skeleton,
        )
        error = np.linalg.norm(found.joints[n] - found.truth[n], axis=1).mean() * HALF_CUBE_MM
        axes.set_title(f"frame {n}: {error:.0f} mm", fontsize=9)
        axes.set_axis_off()
    return figure


def draw_hands(
    axes: Any, depth: Array, center_uvd: Array, truth: Array, predicted: Array, skeleton: Skeleton
) -> None:
    """Draw a crop (128, 128), its true joints (31, 3) in white and the predicted ones in colours,
    in half-cubes.
    """
    axes.imshow(0.8 * (1 - depth) / 2, cmap="gray", vmin=0, vmax=1)
    own, center = joint_colours(skeleton), np.asarray(center_uvd, dtype=np.float64)[None]
    for joints, true in ((truth, True), (predicted, False)):
        xyz = restore_joints(joints[None], NYU.unproject(center), HALF_CUBE_MM)
        pixels = crop_pixels(NYU.project(xyz), center, CUBE_MM)[0]
        for parent, joint in bones(skeleton):
            axes.plot(
                *pixels[[parent, joint]].T,
                color="white" if true else own[joint],
                lw=1 if true else 2,
            )


def joint_colours(skeleton: Skeleton) -> list[tuple[float, ...]]:
    """Each joint's colour in matplotlib's form: red, green, blue, up to 1."""
    return [tuple(channel / 255 for channel in reversed(colour)) for colour in colours(skeleton)]


def joint_errors() -> Any:
    """The mean error of each joint; and how far a finger is bent, in truth and by the network."""
    found = predictions()
    figure = new_figure(8.5, 4.4)
    bars, bent = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.5, 1)})
    errors = np.linalg.norm(found.joints - found.truth, axis=2).mean(axis=0) * HALF_CUBE_MM
    order, own = np.argsort(errors), joint_colours(found.skeleton)
    bars.barh(np.arange(len(order)), errors[order], color=[own[j] for j in order])
    bars.set_yticks(
        np.arange(len(order)), [found.skeleton.joint_names[j] for j in order], fontsize=6
    )
    bars.set(xlabel="mean error, mm", title=f"{len(found.joints)} held-out frames")
    dof = found.skeleton.dof_names.index("middle_dip_rot_x")
    bent.plot([-1.5, 0.6], [-1.5, 0.6], color="0.6", lw=1)
    bent.plot(found.true_inputs[:, dof], found.inputs[:, dof], ".", color=THIRD, ms=3)
    bent.set(xlabel="true, rad", ylabel="predicted, rad", title="middle_dip_rot_x")
    bent.grid(alpha=0.3)
    return figure


class Point(NamedTuple):
    """A network after some iterations: mean errors in mm, and its joints (4, 31, 3) for the
    frames to be drawn.
    """

    iteration: int
    training_mm: float
    held_out_mm: float
    joints: Array


def hands_over_time(points: list[Point], depth: Array, center_uvd: Array, truth: Array) -> Any:
    """Chapter 0: four held-out hands before training, after a tenth of the iterations
    and at the end.
    """
    last = points[-1].iteration
    rows = [point for point in points if point.iteration in (0, last // 10, last)]
    figure = new_figure(8.5, 2.3 * len(rows))
    for axes, point in zip(figure.subplots(len(rows), len(truth), squeeze=False), rows):
        axes[0].set_ylabel(f"{point.iteration} iterations\n{point.held_out_mm:.0f} mm", fontsize=9)
        for n, one in enumerate(axes):
            draw_hands(one, depth[n], center_uvd[n], truth[n], point.joints[n], skeletons.load())
            one.set(xlim=(0, 127), ylim=(127, 0), xticks=[], yticks=[])
    return figure


def errors_over_time(runs: dict[int, list[Point]]) -> Any:
    """Chapter 7: the errors of runs on their training frames and on held-out frames, by the
    number of frames.
    """
    figure = new_figure(8.5, 3.2)
    for axes, (count, points) in zip(figure.subplots(1, 2, sharey=True), runs.items()):
        iterations = [point.iteration for point in points]
        axes.plot(
            iterations,
            [p.held_out_mm for p in points],
            "s--",
            color=SECOND,
            ms=3,
            label="held-out frames",
        )
        axes.plot(
            iterations,
            [p.training_mm for p in points],
            "o-",
            color=FIRST,
            ms=3,
            label="training frames",
        )
        axes.set(title=f"{count:,} training frames", xlabel="iteration", ylim=(0, 105))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("mean error, mm")
    figure.axes[0].legend(fontsize=8)
    return figure
