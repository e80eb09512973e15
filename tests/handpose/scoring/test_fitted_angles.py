"""handpose/scoring/published_predictions.py"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import numpy as np

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.scoring.published_predictions import compare_angles
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of

SKELETON = skeletons.load()


def test_a_method_without_errors() -> None:
    """Exact joints have no residual and no angle beyond the limits; progress covers every frame of each fit."""
    inputs = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)).draw(np.random.default_rng(2), 2).inputs
    truth = kinematics_of(SKELETON).joints(inputs)[:, EVALUATION_JOINTS] * 150 + (0, 0, 700)
    watched: list[tuple[str, int, int]] = []

    @contextlib.contextmanager
    def watch(total: int, *, what: str) -> Iterator[Callable[[int], None]]:
        done: list[int] = []
        yield done.append
        watched.append((what, total, sum(done)))

    found = compare_angles(SKELETON, truth, {"same": truth}, watch)["same"]
    assert watched == [(what, 2, 2) for what in ("annotation", "same", "same, no limits", "same, exactly")]
    assert found.residual_mm < 0.1 and found.free_residual_mm < 0.01
    assert found.out_of_limits == 0
    assert found.error_deg < 8, "the ridge moves only angles that 14 joints hardly determine"


def test_a_finger_beyond_its_limits_and_noise() -> None:
    """Angles beyond the limits are counted for joints on the model; noise is not on it."""
    inputs = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)).draw(np.random.default_rng(2), 2).inputs
    bent = inputs.copy()
    dof = SKELETON.dof_names.index("index_base_rot_z")
    bent[1, dof] = SKELETON.upper[dof] + 0.3
    truth, beyond = (
        kinematics_of(SKELETON).joints(x)[:, EVALUATION_JOINTS] * 150 + (0, 0, 700) for x in (inputs, bent)
    )
    noise = truth + np.random.default_rng(0).normal(0, 5, truth.shape)
    found = compare_angles(SKELETON, truth, {"beyond": beyond, "noise": noise})
    assert found["beyond"].out_of_limits == 0.5 and found["noise"].out_of_limits is None
    assert found["beyond"].free_residual_mm < 0.01 < 0.1 < found["beyond"].residual_mm
    assert found["noise"].free_residual_mm < found["noise"].residual_mm < 8  # mm; noise of 5 mm per axis
    assert 0 < found["beyond"].error_deg < found["noise"].error_deg < 60
