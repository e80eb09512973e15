"""Draw figures of the book into docs/images/book.

python -m docs.making.figures            all, in about a minute
python -m docs.making.figures arm crop   some, by name

learned.svg and by_heart.svg need minutes of training: python -m docs.making.five_minutes --book.
whole_net.svg and joint_angles.svg show what does not change, and have no program.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from docs.making.figures import hand, ideas, nets, training, whole
from docs.making.figures.drawing import PLACE, write
from tools.common.arguments import parser_of

FIGURES: dict[str, Callable[[], Any]] = {
    "differences": training.differences,
    "valley": training.valley,
    "rates": training.rates,
    "overfitting": training.overfitting,
    "hinge": training.hinge,
    "initial": training.initial,
    "circuit": ideas.circuit,
    "outer": ideas.outer,
    "window": ideas.window,
    "im2col": ideas.im2col,
    "winners": ideas.winners,
    "pass": ideas.small_pass,
    "dropout": ideas.dropout,
    "rotations": ideas.rotations,
    "box": ideas.torque_box,
    "arm": hand.arm,
    "hand_joints": hand.hand_joints,
    "lever": hand.lever,
    "reach": hand.reach,
    "stack": nets.stack,
    "kernels": nets.kernels,
    "crop": whole.crop,
    "six_hands": whole.six_hands,
    "joint_errors": whole.joint_errors,
}


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "names", metavar="NAME", nargs="*", help=f"of {', '.join(FIGURES)} (default: all)"
    )
    args = parser.parse_args(argv)
    if unknown := [name for name in args.names if name not in FIGURES]:
        parser.error(f"unknown figure {unknown[0]!r}; expected one of {', '.join(FIGURES)}")
    for name in args.names or FIGURES:
        write(FIGURES[name](), PLACE / f"{name}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
