"""handpose/fit/joints/calibration_problem.py: derivatives and equations."""

import numpy as np
import pytest

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.joints import calibration_problem
from handpose.fit.joints.calibration_problem import CalibrationProblem, State
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton, load
from layers.hand.skeleton_file import SkeletonParameter
from netlib.proto import prototxt, schema

HAND = load()
COUPLED = """
    dof { name: "x" } dof { name: "turn" initial: 0.2 } dof { name: "bend" initial: 0.3 }
    dof { name: "tilt" initial: 0.4 fixed: true } dof { name: "slide" initial: 0.1 fixed: true }
    joint { name: "tip" parent: "middle" rotate { axis: NEG_Y dof: "bend" } rotate { axis: Z dof: "tilt" }
            bone { axis: NEG_X length: 0.5 } }
    joint { name: "middle" parent: "base" rotate { axis: X dof: "tilt" } rotate { axis: Z dof: "bend" }
            bone { axis: Y length: 0.7 } }
    joint { name: "base" translate { axis: X dof: "x" } translate { axis: Y dof: "slide" }
            rotate { axis: Z dof: "turn" } }
"""


COUPLED_BODY = Skeleton(schema.read(prototxt.parse(COUPLED), SkeletonParameter, "test"))


def random_problem(skeleton, joints, frames, rng):
    """A problem with a missing joint, and a state that differs from the template."""
    goal = rng.normal(0, 0.3, (frames, len(joints), 3))
    goal[0, 0] = np.nan
    problem = CalibrationProblem(skeleton, goal, joints)
    shared = rng.normal(0, 0.5, len(problem.spread))
    return problem, State(problem.state(np.zeros((frames, len(skeleton.initial)))).theta + rng.normal(
        0, 0.4, (frames, len(problem.free))), shared)


@pytest.mark.parametrize(("skeleton", "joints"), [(HAND, range(31)), (HAND, EVALUATION_JOINTS), (COUPLED_BODY, [2, 0])])
def test_derivative_against_differences(skeleton, joints, rng):
    """The derivative by poses, fixed angles and bones equals central differences, also for DoFs of two joints."""
    problem, state = random_problem(skeleton, joints, 3, rng)
    every, h = slice(0, 3), 1e-6
    J, r = problem.derivative(state, every)
    F, S = len(problem.free), len(problem.spread)
    assert J.shape == (3, F + S, 3 * len(joints)) and not r[0, :3].any()

    def residual(theta, shared):
        moved = State(state.theta + theta, state.shared + shared)
        return problem.residual(problem.kinematics.joints(*problem.body(moved, every)), every)

    for k in range(F + S):
        step = h * np.eye(F + S)[k]
        slope = (residual(step[:F], step[F:]) - residual(-step[:F], -step[F:])) / (2 * h)
        assert np.allclose(J[:, k], slope, atol=1e-8), k


def test_the_open_skeleton_is_the_template(rng):
    """With all shared numbers 0 the joints are the template's."""
    problem, _ = random_problem(HAND, range(31), 4, rng)
    inputs = rng.normal(0, 0.3, (4, 47))
    found = problem.kinematics.joints(*problem.body(problem.state(inputs), slice(None)))
    assert np.allclose(found, kinematics_of(HAND).joints(inputs))


@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_a_step_solves_the_whole_system(rng, mu, monkeypatch):
    """The reduced equations have the same solution as the full system of all poses and shared numbers."""
    monkeypatch.setattr(calibration_problem, "CHUNK", 2)
    N, noise = 5, 0.02
    problem, state = random_problem(HAND, range(31), N, rng)
    F, S = len(problem.free), len(problem.spread)
    J, r = problem.derivative(state, slice(None))
    G = np.zeros((N * F + S, N, J.shape[2]))
    for n in range(N):
        G[n * F : n * F + F, n], G[N * F :, n] = J[n, :F], J[n, F:]
    G = G.reshape(N * F + S, -1)
    ridge = noise**2 * np.concatenate([np.tile(problem.pose_ridge, N), np.full(S, problem.shared_ridge)])
    place = np.concatenate([(state.theta - HAND.initial[problem.free]).ravel(), state.shared])
    M = G @ G.T + np.diag(ridge)
    M += mu * np.diag(np.diag(M))
    M[: N * F, : N * F] += 1e-3 * problem.least_noise**2 * np.eye(N * F)
    whole = np.linalg.solve(M, -(G @ r.ravel() + ridge * place))
    matrix, right, by_shared, own = problem.reduced(problem.normal(state), state, noise, mu)
    du = np.linalg.solve(matrix, right)
    assert np.allclose(du, whole[N * F :], rtol=1e-5, atol=1e-7)
    assert np.allclose((-own - by_shared @ du).ravel(), whole[: N * F], rtol=1e-5, atol=1e-7)
