"""The reference angles of the networks of Table 1: the hand fitted to all annotated joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from handpose.fit.joints import companions
from layers.hand.skeleton import Skeleton
from netlib.blob import Array

RIDGE = 3e-4  # sufficient, because 31 joints determine nearly all angles
RECIPE = f"ridge{RIDGE:g}_v{companions.VERSION}"  # their other parameters


def fit_true_angles(
    split: str,
    files: Sequence[Path],
    out: Path,
    skeleton: Skeleton,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Array, Array]:
    """Fit the hand to the joints of a split, unless that is done already; the angles go to the folder ``out``.

    Returns the inputs (N, D) and the remaining distance of each joint, (N, K) mm. ``progress`` is called with the
    number of further frames. Raises DataError.
    """
    return companions.fit_list(files, out, f"{split}.txt", skeleton, ridge=RIDGE, progress=progress)
