"""Fitting poses to joints."""

import itertools

import numpy as np
import pytest

import netlib
from handpose.body.nyu import EVALUATION_JOINTS, cube_of_test_frame
from handpose.fit.joints import angles
from handpose.fit.joints.fit_joints import fit_absolute, fit_joints
from handpose.frames.cameras import NYU
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from tests.support.made_tracks import skeleton_of

NYU_HAND = skeletons.load()  # the labels that are fitted are of NYU's joints


def joints_of(body, inputs):
    """Joints (N, K, 3)."""
    return kinematics_of(body).joints(inputs)


@pytest.fixture(scope="module")
def inputs():
    """Inputs (40, 47) of synthetic hands; their joints are computed with the packaged bones."""
    return BodySampler().draw(np.random.default_rng(7), 40).inputs


@pytest.mark.parametrize("limits", [True, False])
def test_all_joints_determine_the_pose(inputs, limits):
    """31 joints are fitted to 1e-5 half-cubes, and the median error of canonical angles is
    below 0.01 degrees.
    """
    found = fit_joints(NYU_HAND, joints_of(NYU_HAND, inputs), limits=limits, starts=32)
    assert found.residuals.max() < 1e-5
    errors = angles.angle_errors(NYU_HAND, found.inputs, inputs)
    assert np.median(errors.max(axis=1)) < 0.01


def test_a_body_without_a_rotating_root_is_fitted():
    """From its initial rotation alone."""
    text = """dof { name: "bend" }
        joint { name: "root" bone { axis: X length: 1 } }
        joint { name: "tip" parent: "root" rotate { axis: Z dof: "bend" } bone { axis: X length: 1 } }"""
    arm = skeleton_of(text)
    bent = np.array([[0.5], [-2.0]])
    assert np.allclose(fit_joints(arm, joints_of(arm, bent)).inputs, bent, atol=1e-6)


@pytest.mark.parametrize("limits", [True, False])
def test_a_root_that_turns_about_two_axes_is_fitted_within_its_limits(rng, limits):
    """Half a turn of the root affects joints below it; both forms of the pose are valid."""
    text = """dof { name: "a" lower: -3 upper: 3 } dof { name: "b" lower: -3 upper: 3 }
        dof { name: "c" lower: -2 upper: 1 }
        joint { name: "root" rotate { axis: Z dof: "a" } rotate { axis: X dof: "b" } bone { axis: Y length: 1 } }
        joint { name: "tip" parent: "root" rotate { axis: X dof: "c" } bone { axis: Y length: 1 } }"""
    arm = skeleton_of(text)
    found = fit_joints(arm, joints_of(arm, rng.uniform(-2, 1, (50, 3))), limits=limits)
    assert found.residuals.max() < 1e-5
    if limits:
        assert (found.inputs >= arm.lower - 1e-9).all()
        assert (found.inputs <= arm.upper + 1e-9).all()


def test_frames_with_missing_joints_are_fitted_to_the_others(inputs):
    """The positions of nearby joints are recovered."""
    targets = joints_of(NYU_HAND, inputs)
    hidden = targets.copy()
    hidden[::2, [0, 5, 28]] = np.nan  # tips and a joint of the thumb
    hidden[3, 7, 1] = np.nan  # one missing coordinate makes the joint unknown
    found = fit_joints(NYU_HAND, hidden, starts=32)
    assert np.isnan(found.residuals[::2, [0, 5, 28]]).all()
    assert np.isnan(found.residuals[3, 7])
    assert np.nanmax(found.residuals) < 1e-5
    off = joints_of(NYU_HAND, found.inputs) - targets
    assert np.abs(off[:, [1, 6, 29]]).max() < 1e-4


def test_joints_at_absolute_positions_are_fitted_in_each_hands_unit(inputs):
    """About its own centre, to within 0.01 mm; residuals are in mm."""
    half = np.array([150.0, 130.5, 150.0])
    xyz = joints_of(NYU_HAND, inputs[:3]) * half[:, None, None] + (20, -30, 800)
    for off in (0, 10):
        xyz[:, 0, 0] += off
        found, center = fit_absolute(NYU_HAND, xyz, half, range(31), starts=4)
        placed = joints_of(NYU_HAND, found.inputs) * half[:, None, None] + center[:, None]
        assert (np.abs(placed - xyz).max() < 0.01) == (off == 0)
        assert found.residuals == pytest.approx(np.linalg.norm(placed - xyz, axis=2), abs=1e-6)


def test_inputs_stay_within_their_limits(inputs, rng):
    """Without limits the residual is lower."""
    targets = joints_of(NYU_HAND, inputs)[:20, EVALUATION_JOINTS] + rng.normal(0, 0.05, (20, 14, 3))
    inside, free = (
        fit_joints(NYU_HAND, targets, EVALUATION_JOINTS, limits=limits, starts=4)
        for limits in (True, False)
    )
    assert (inside.inputs >= NYU_HAND.lower - 1e-12).all()
    assert (inside.inputs <= NYU_HAND.upper + 1e-12).all()
    assert (free.inputs[:, NYU_HAND.fixed] == 0).all()
    assert (free.residuals**2).sum() < (inside.residuals**2).sum()
    assert (free.inputs > NYU_HAND.upper).any()


def test_a_larger_ridge_gives_smaller_angles(inputs, rng):
    """The residual is larger."""
    targets = joints_of(NYU_HAND, inputs)[:20, EVALUATION_JOINTS] + rng.normal(0, 0.02, (20, 14, 3))
    fingers = np.setdiff1d(angles.rotations(NYU_HAND), (3, 4, 5))
    sizes, residuals = [], []
    for ridge in (0, 3e-3, 0.1):
        found = fit_joints(NYU_HAND, targets, EVALUATION_JOINTS, ridge=ridge, starts=4)
        sizes.append((found.inputs[:, fingers] ** 2).sum())
        residuals.append((found.residuals**2).sum())
    assert sizes[0] > sizes[1] > sizes[2]
    assert residuals[0] < residuals[1] < residuals[2]


def test_the_result_is_a_minimum(inputs, rng):
    """No small step of an angle lowers the cost, as computed from the joints, without the fit's
    own derivative.
    """
    targets = joints_of(NYU_HAND, inputs)[:5, EVALUATION_JOINTS] + rng.normal(0, 0.02, (5, 14, 3))
    found = fit_joints(NYU_HAND, targets, EVALUATION_JOINTS, limits=False)

    def cost(x):
        return ((joints_of(NYU_HAND, x)[:, EVALUATION_JOINTS] - targets) ** 2).sum(axis=(1, 2))

    for dof in np.unique(NYU_HAND.driven):
        for step in (1e-2, -1e-2):
            moved = found.inputs.copy()
            moved[:, dof] += step
            assert (cost(moved) >= cost(found.inputs) - 1e-9).all()


def test_results_do_not_depend_on_the_number_of_threads(inputs, rng, monkeypatch):
    """They are equal bit for bit."""
    monkeypatch.setattr("handpose.fit.joints.fit_joints.CHUNK", 8)
    targets = joints_of(NYU_HAND, inputs)[:20, EVALUATION_JOINTS] + rng.normal(0, 0.02, (20, 14, 3))
    before = netlib.threads()
    results = []
    try:
        for count in (1, 2):
            netlib.set_threads(count)
            results.append(fit_joints(NYU_HAND, targets, EVALUATION_JOINTS, starts=2).inputs)
    finally:
        netlib.set_threads(before)
    assert np.array_equal(*results)


def test_published_predictions_lie_on_the_model(nyu_data):
    """Every 160th published prediction is fitted to 0.001 mm, because the predictions come from
    this hand model.
    """
    with open(nyu_data / "predictions" / "IJCAI16_NYU_DeepModel.txt", encoding="utf-8") as lines:
        uvd = np.loadtxt(itertools.islice(lines, 0, None, 160)).reshape(-1, 14, 3)
    half = cube_of_test_frame(np.arange(0, 8252, 160))[:, None, None] / 2
    xyz = NYU.unproject(uvd)
    joints = (xyz - xyz.mean(axis=1, keepdims=True)) / half
    found = fit_joints(NYU_HAND, joints, EVALUATION_JOINTS, limits=False, starts=64)
    assert (found.residuals * half[:, :, 0]).mean(axis=1).max() < 0.001
