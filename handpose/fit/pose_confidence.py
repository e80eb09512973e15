"""Expected error and confidence of a pose as it is reported, by the image in which it was found.

A fit's table (``network_errors``) knows the cost of the fit alone. The reported pose may be smoothed, its joints may be
in empty space, and a fit to the visible part of a covered hand costs no more than one of a whole hand. So what is
reported is judged by more signs, all 0 or more:

    surface, outline, front, prior, moved   of the fit, as in ``network_errors``
    behind       mm, by which its joints are behind the surface that was read: the hand hides them itself
    before       mm, by which they are in front of it, in empty space
    penetration  mm, mean over the capsules of how deep another part penetrates them

The logarithm of the error in mm is taken to be normally distributed, with the deviation SPREAD. Its mean is

    mean = log √(fit² + lag² + before²)        log fit = Σ WEIGHTS log(1 + sign) + CONSTANT

with the lag, the mean distance in mm of the reported joints from those of the fit, because no reported pose can be
better than that. So

    expected error = exp(mean + SPREAD² / 2)        confidence = P(error < 30 mm) = Φ((log 30 - mean) / SPREAD)

Where less of the hand's own surface was seen at its place, the rest is a guess, whatever the signs: UNSEEN. docs/fit.md
has the frames from which the weights were computed, and the results on others.
"""

from __future__ import annotations

import numpy as np

from handpose.fit.network_errors import GOOD_MM, LOST_MM
from handpose.fit.network_errors import SIGNS as FIT_SIGNS
from handpose.fit.support import JointDepths, Support
from netlib.blob import Array

SIGNS = (*FIT_SIGNS, "behind", "before", "penetration")
WEIGHTS = np.array([0.19, 0.21, 0.19, 0.16, 0.13, 0.28, 0.05, 0.05])
CONSTANT = -0.29
SPREAD = 0.4  # between the deviation in the sequences of the regression, 0.32, and in each when it is left out, 0.54
# Share of the surface that faces the camera and was not seen at its place; factors of confidence and expected error.
UNSEEN, UNSEEN_CONFIDENCE, UNSEEN_ERROR = (0.15, 0.3, 0.45, 0.6), (1.0, 0.7, 0.3, 0.1), (1.0, 1.3, 2.0, 3.0)
MAX_SIGN = 1e6  # instead of the infinite signs of an empty crop


def pose_signs(fit: Array, depths: JointDepths, penetration_mm: Array) -> Array:
    """The signs (N, 8) of N poses; ``fit`` (N, 5) are those of their fits."""
    return np.minimum(np.column_stack([fit, depths.behind, depths.before, penetration_mm]), MAX_SIGN)


def judged(signs: Array, lag_mm: Array, support: Support) -> tuple[Array, Array]:
    """Expected error in mm, and probability of an error below GOOD_MM, (N,) each, of poses with these signs (N, 8)."""
    fit = np.exp(np.log1p(signs) @ WEIGHTS + CONSTANT)
    mean = np.log(np.sqrt(fit**2 + lag_mm**2 + signs[:, SIGNS.index("before")] ** 2))
    unseen = 1 - support.seen
    error = np.exp(mean + SPREAD**2 / 2) * np.interp(unseen, UNSEEN, UNSEEN_ERROR)
    confidence = _normal((np.log(GOOD_MM) - mean) / SPREAD) * np.interp(unseen, UNSEEN, UNSEEN_CONFIDENCE)
    return np.minimum(error, LOST_MM), confidence


def _normal(x: Array) -> Array:
    """The standard normal distribution function Φ."""
    from scipy.special import ndtr  # imported here, because few programs need it

    return np.asarray(ndtr(x))
