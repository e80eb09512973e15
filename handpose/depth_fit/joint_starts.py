"""Starts of a depth fit from joints that a network predicts.

Joints predicted one by one are more accurate than those of predicted angles, but they need not be joints of the body.
So the start is the x that minimises, with x_0 from the predicted angles and size,

    |X(x) - joints|^2 / JOINT_MM^2  +  sum over limbs of (x - x_0)^2 / LIMB^2  +  (log size - log size_0)^2 / SIZE_STD^2

by Levenberg-Marquardt from x_0. The result depends little on these constants.
"""

from __future__ import annotations

import numpy as np

from handpose.depth_fit.body import SIZE, CapsuleModel
from handpose.joint_fit.damped_step import damped_step
from layers.hand.bodies import kinematics_of
from netlib.blob import Array

JOINT_MM, LIMB, SIZE_STD = 10.0, 0.6, 0.1
STEPS = 8
FIRST_MU, TRUST, MISTRUST, RIDGE = 1e-2, 1 / 3, 4.0, 1e-9


def near_joints(model: CapsuleModel, x: Array, joints: Array) -> Array:
    """Fit bodies x (N, V) to joints (N, K, 3) in mm; variables that the surface alone has are not changed."""
    skeleton, kinematics = model.skeleton, kinematics_of(model.skeleton)
    free = np.unique(skeleton.driven)
    sums = (skeleton.driven[:, None] == free).astype(float)
    columns = np.append(np.searchsorted(model.free, free), model.variables + SIZE)
    lower, upper = model.lower[columns], model.upper[columns]
    unit, diagonal = JOINT_MM / model.unit_mm, np.arange(len(columns))
    precision = np.where(np.isin(columns, model.limbs), LIMB**-2.0, 0.0)
    precision[-1] = SIZE_STD**-2.0
    goal, root = joints / model.unit_mm, int(np.flatnonzero(skeleton.parents < 0)[0])

    def evaluate(x: Array) -> tuple[Array, Array, Array]:
        """Cost (N,), curvature (N, F, F) and half gradient (N, F)."""
        pose = kinematics.forward(model.inputs_of(x), skeleton.bones * np.exp(x[:, [SIZE]]))
        grows = (pose.joints - pose.joints[:, [root]]).reshape(len(x), 1, -1)
        J = np.concatenate([sums.T @ kinematics.jacobian(pose), grows], axis=1) / unit
        r = (pose.joints - goal).reshape(len(x), -1, 1) / unit
        off = x[:, columns] - start
        A = J @ J.swapaxes(1, 2)
        A[:, diagonal, diagonal] += precision
        b = (J @ r)[..., 0] + precision * off
        return (r * r).sum(axis=(1, 2)) + (precision * off * off).sum(axis=1), A, b

    x = x.copy()
    start, mu = x[:, columns], np.full(len(x), FIRST_MU)
    cost, A, b = evaluate(x)
    for _ in range(STEPS):
        own = x[:, columns]
        step = damped_step(A.copy(), b, mu, own, lower, upper, RIDGE)
        trial = x.copy()
        trial[:, columns] = np.clip(own + step, lower, upper)
        found = evaluate(trial)
        better = found[0] < cost
        x[better] = trial[better]
        for kept, new in zip((cost, A, b), found):
            kept[better] = new[better]
        mu *= np.where(better, TRUST, MISTRUST)
    return x
