"""Figures of chapters 0 and 7: what the network can do after some iterations, and what it learns by heart."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from docs.making import training
from docs.making.figures.drawn import new_figure
from docs.making.figures.whole import joint_colours, places
from docs.making.palette import FIRST, SECOND
from docs.making.training import Frames, Point
from handpose.output.drawing.hands import bones
from layers.hand import skeleton as skeletons


@functools.cache
def _shown_frames() -> Frames:
    """The frames that are drawn: rendered once."""
    found = training.rendered("test", max(training.SHOWN) + 1)
    return Frames(*(array[list(training.SHOWN)] for array in found))


def hands_over_time(points: Sequence[Point]) -> Any:
    """Held-out hands before training, after a tenth of the iterations and at the end: predicted in colours, true white.

    The points between have no joints to show, or are left out.
    """
    last = points[-1].iteration
    rows = [point for point in points if point.iteration in (0, last // 10, last)]
    frames, skeleton = _shown_frames(), skeletons.load()
    own = joint_colours(skeleton)
    figure = new_figure(8.5, 2.3 * len(rows))
    for axes, point in zip(figure.subplots(len(rows), len(training.SHOWN), squeeze=False), rows):
        axes[0].set_ylabel(f"{point.iteration} iterations\n{point.held_out_mm:.0f} mm", fontsize=9)
        for n, one in enumerate(axes):
            one.imshow(0.8 * (1 - frames.depth[n, 0]) / 2, cmap="gray", vmin=0, vmax=1)
            for joints, true in ((frames.joints[n], True), (np.array(point.shown[n]), False)):
                at = places(joints, frames.center_uvd[n])
                for parent, joint in bones(skeleton):
                    ends = at[[parent, joint]]
                    one.plot(ends[:, 0], ends[:, 1], color="white" if true else own[joint], lw=1 if true else 2)
            one.set(xlim=(0, 127), ylim=(127, 0), xticks=[], yticks=[])
    return figure


def learned() -> Any:
    """The recorded run of many frames."""
    return hands_over_time(training.recorded().runs[training.FRAMES])


def by_heart() -> Any:
    """The errors of both recorded runs on their training frames and on held-out frames."""
    figure = new_figure(8.5, 3.2)
    for axes, (count, points) in zip(figure.subplots(1, 2, sharey=True), training.recorded().runs.items()):
        iterations = [point.iteration for point in points]
        axes.plot(
            iterations, [point.held_out_mm for point in points], "s--", color=SECOND, ms=3, label="held-out frames"
        )
        axes.plot(iterations, [point.training_mm for point in points], "o-", color=FIRST, ms=3, label="training frames")
        axes.set(title=f"{count:,} training frames", xlabel="iteration", ylim=(0, 105))
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("mean error, mm")
    figure.axes[0].legend(fontsize=8)
    return figure
