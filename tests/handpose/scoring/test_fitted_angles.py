"""handpose/scoring/fitted_angles.py; more of it in the tests of tools/evaluate.py"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import numpy as np

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.scoring.fitted_angles import compare_angles
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
