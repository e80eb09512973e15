"""The figures of the book: one table, a function each, which draws what the code computes now."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from docs.making.figures import chain, graph, hand, ideas, learned, learning, pictures, whole
from docs.making.figures.drawn import as_svg, shows_the_same
from docs.making.made import Made
from netlib.files.paths import ROOT

FIGURES: dict[str, Callable[[], Any]] = {  # name of the file in docs/images/book: a function that gives a Figure
    "circuit": ideas.circuit,
    "differences": chain.differences,
    "outer": ideas.outer,
    "initial": ideas.initial,
    "window": ideas.window,
    "im2col": ideas.im2col,
    "winners": ideas.winners,
    "pass": ideas.small_pass,
    "overfitting": ideas.overfitting,
    "dropout": ideas.dropout,
    "rotations": ideas.rotations,
    "box": ideas.torque_box,
    "stack": pictures.stack,
    "kernels": pictures.kernels,
    "whole_net": graph.whole_net,
    "valley": learning.valley,
    "rates": learning.rates,
    "arm": hand.arm,
    "hand_joints": hand.joints,
    "lever": hand.lever,
    "reach": hand.reach,
    "joint_angles": hand.joint_angles,
    "learned": learned.learned,
    "by_heart": learned.by_heart,
    "hinge": whole.hinge,
    "crop": whole.crop,
    "six_hands": whole.six_hands,
    "joint_errors": whole.joint_errors,
}


def made() -> Iterator[Made]:
    """Every figure as SVG; one that shows the same values and words is as good, whatever matplotlib wrote it."""
    for name, draw in FIGURES.items():
        yield Made(ROOT / "docs" / "images" / "book" / f"{name}.svg", functools.partial(_file, draw), shows_the_same)


def _file(draw: Callable[[], Any]) -> bytes:
    return as_svg(draw())
