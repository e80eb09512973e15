"""The angles that the networks of Table 1 are compared with: the hand fitted to all annotated joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from handpose.joint_fit import companions
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

RIDGE = 3e-4  # enough where 31 joints determine nearly all angles
RECIPE = f"ridge{RIDGE:g}_v{companions.VERSION}"  # all that they depend on beside the joints


def fit_true_angles(
    split: str,
    files: Sequence[Path],
    out: Path,
    skeleton: Skeleton,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Array, Array]:
    """Fit the hand to the joints of a split, unless that is done already; the angles go to the folder ``out``.

    Returns the inputs (N, D) and what the fit leaves of each joint, (N, K) mm. ``progress`` is told how many frames
    more are done. Raises DataError.
    """
    return companions.fit_list(files, out, f"{split}.txt", skeleton, ridge=RIDGE, progress=progress)
