"""Expected error of each finger of a pose as it is reported, by the image in which it was found.

The error of a hand is a mean over its joints (``pose_confidence``), and a hand that is right as a whole may have a
finger that is a guess: because the palm or another finger hides it, because it is in empty space, or because the
smoothed pose lags. With means over the finger's PIP joint, DIP joint and tip (of the thumb: MCP joint, IP joint and
tip), the logarithm of the error in mm is taken to be normally distributed, with the deviation SPREAD and the mean

    mean = 0.327 log(hand's expected error) + 0.270 log(1 + behind) + 0.118 log(1 + before) + 0.095 log(1 + lag)
           + 0.291 (1 - seen) + 0.715

    behind, before  mm, by which the joints are behind and in front of the readings (``support.joint_depths``)
    lag             mm, distance of the reported joints from those of the fit
    seen            share of the finger's own surface that was seen at its place; 0 if the hand itself covers all of it

so that the expected error is exp(mean + SPREAD**2 / 2), at most LOST_MM.

The weights are those of a regression on the sequences P1, P4 and hpx, tracked as recorded and mirrored, in which these
joints are labelled. docs/fit.md has the results on other sequences.
"""

from __future__ import annotations

import numpy as np

from handpose.body.fingers import FINGERS
from handpose.fit.network_errors import LOST_MM
from netlib.blob import Array

OF_HAND, OF_BEHIND, OF_BEFORE, OF_LAG, OF_UNSEEN, CONSTANT = 0.327, 0.270, 0.118, 0.095, 0.291, 0.715
SPREAD = 0.443


def unknown_errors() -> Array:
    """The errors (5,) of fingers about which nothing is known: NaN."""
    return np.full(len(FINGERS), np.nan)


def finger_errors(error_mm: Array, behind: Array, before: Array, lag_mm: Array, seen: Array) -> Array:
    """The expected errors (N, 5) in mm of the fingers of N hands with the expected errors (N,) in mm.

    behind, before, lag_mm, seen  (N, 5) of the fingers
    """
    mean = OF_HAND * np.log(error_mm)[:, None] + OF_UNSEEN * (1 - seen) + CONSTANT
    mean += OF_BEHIND * np.log1p(behind) + OF_BEFORE * np.log1p(before) + OF_LAG * np.log1p(lag_mm)
    return np.minimum(np.exp(mean + SPREAD**2 / 2), LOST_MM)
