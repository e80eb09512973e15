"""Fits to joints at absolute positions in mm, as in files of predictions.

There is no crop; each frame is centred at the mean of its joints instead.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from handpose.fit.joints.fit_joints import JointFit, fit_joints
from layers.hand.skeleton import Skeleton
from netlib import files
from netlib.blob import Array
from netlib.files import hdf5

DESCRIPTION = "dof: inputs of the hand model, radians, and half-cubes from center (mm, camera axes, y up)"


@dataclass(frozen=True)
class AbsoluteFit:
    """The best pose of every frame.

    inputs     (N, D) of the hand model; lengths in half-cubes from the centre
    residuals  (N, K) half-cubes
    center     (N, 3) mm, camera axes
    half_cube  (N,) mm
    """

    inputs: Array
    residuals: Array
    center: Array
    half_cube: Array

    @property
    def residuals_mm(self) -> Array:
        """(N, K) distances between the joints of the model and the given ones."""
        return np.asarray(self.residuals * self.half_cube[:, None])


def fit_absolute(
    skeleton: Skeleton, xyz: Array, half_cube: Array, joints: Sequence[int], *,
    fit: Callable[..., JointFit] = fit_joints, **options: Any,
) -> AbsoluteFit:
    """Fit the hand to joints (N, K, 3) in mm, whose unit of the skeleton is ``half_cube`` (N,) mm. Raises DataError.

    joints   indices of the K joints in the skeleton
    fit      ``fit_joints`` or ``fit_joints_by_swarm``, with its options
    """
    center = xyz.mean(axis=1, keepdims=True)
    found = fit(skeleton, (xyz - center) / half_cube[:, None, None], joints, **options)
    return AbsoluteFit(found.inputs, found.residuals, center[:, 0], half_cube)


def write_fit(path: Path, found: AbsoluteFit, index: NDArray[np.int_]) -> None:
    """Write angles and residuals to an HDF5 file atomically; ``index`` (N,) are the numbers of the frames."""
    files.make_folder(path.parent)
    with hdf5.created(path) as file:
        file["dof"], file["residual_mm"] = found.inputs, found.residuals_mm
        file["index"], file["center"], file["half_cube"] = index, found.center, found.half_cube
        file.attrs["description"] = DESCRIPTION
