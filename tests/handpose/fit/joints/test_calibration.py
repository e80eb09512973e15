"""Calibration of a person's hand from annotated frames: known hands are recovered, undetermined parts are reported."""

import dataclasses

import numpy as np
import pytest

import netlib
from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.joints import calibration, calibration_problem
from handpose.fit.joints.calibration import calibrate
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton_file import SkeletonParameter, text_of
from netlib.proto import prototxt, schema

HAND = skeleton.load()
BONES = np.flatnonzero(HAND.bone_axes >= 0)
MM = 1 / 150  # in half-cubes


def person(seed):
    """A hand with bones up to 15% longer or shorter than the packaged one's, and fixed angles up to 0.1 rad away."""
    rng = np.random.default_rng(seed)
    bones = HAND.bones * rng.uniform(0.85, 1.15, len(HAND.bones))
    dofs = [dataclasses.replace(d, initial=d.initial + d.fixed * rng.uniform(-0.1, 0.1)) for d in HAND.param.dof]
    return HAND.with_numbers(dofs, bones)


def poses(count, seed=0):
    return BodySampler().draw(np.random.default_rng(seed), count).inputs


def errors(skeleton, truth):
    """Relative errors (30,) of the bones."""
    return np.abs(skeleton.bones[BONES] / truth.bones[BONES] - 1)


def joints_of(hand, inputs):
    return kinematics_of(hand).joints(inputs)


@pytest.fixture(scope="module")
def exact():
    """A person, 100 frames of that person, and the calibration from all joints."""
    truth = person(1)
    targets = joints_of(truth, poses(100, seed=1))
    return truth, targets, calibrate(HAND, targets)


# ------------------------------------------------------------------------------------------------ known hands


def test_exact_joints_give_the_hand_back(exact):
    """Bones are recovered to 0.1% and joints to 0.02 mm; the template's errors were above 8% and 2 mm."""
    truth, targets, found = exact
    assert errors(found.start, truth).max() > 0.08 and np.mean(found.before) > 2 * MM
    assert errors(found.skeleton, truth).max() < 1e-3
    assert np.allclose(joints_of(found.skeleton, found.inputs), targets, atol=0.02 * MM)
    assert np.allclose(found.after, np.linalg.norm(joints_of(found.skeleton, found.inputs) - targets, axis=2))
    assert found.undetermined_bones == [] and (found.bone_deviation[BONES] < 0.3 * MM).all()


def test_the_null_directions_stay_at_the_template(exact):
    """Angles that move no joint, such as the twist of the wrist's points, keep the template's values."""
    _, _, found = exact
    assert found.undetermined_angles == ["wrist_left_rot_y", "wrist_middle_rot_y"]
    for name in found.undetermined_angles:
        dof = HAND.dof_names.index(name)
        assert found.skeleton.initial[dof] == pytest.approx(HAND.initial[dof], abs=1e-6)
    assert np.abs(found.skeleton.initial - HAND.initial)[HAND.fixed].max() < 0.3


def test_initial_pose_and_limits(exact):
    """Inputs have median 0, and their percentiles are the limits; the palm has no limits."""
    _, targets, found = exact
    free = np.flatnonzero(~HAND.fixed)
    for percentile, result in ((0.5, found), (10, calibrate(HAND, targets, percentile=10, starts=2))):
        sk, inputs = result.skeleton, result.inputs
        assert np.abs(np.median(inputs[:, free], axis=0)).max() < 1e-5
        assert (sk.lower[:6] == HAND.lower[:6]).all() and (sk.upper[:6] == HAND.upper[:6]).all()
        low, high = np.percentile(inputs[:, free[6:]], (percentile, 100 - percentile), axis=0)
        assert np.allclose(sk.lower[free[6:]], low, atol=1e-6) and np.allclose(sk.upper[free[6:]], high, atol=1e-6)
        assert (sk.lower[free] < 0).all() and (sk.upper[free] > 0).all()
        assert (sk.fixed == HAND.fixed).all() and not inputs[:, sk.fixed].any()


def test_the_size_alone(exact):
    """The size is determined from distances within the palm, also for a hand in another unit."""
    truth, targets, found = exact
    assert found.scale == pytest.approx(calibration.size(HAND, targets, range(31)))
    assert calibration.size(HAND, joints_of(HAND, poses(5)) * 0.7, range(31)) == pytest.approx(0.7)
    in_mm = calibrate(HAND, targets[:60] * 150, starts=4)
    assert errors(in_mm.skeleton, truth.scaled(150)).max() < 2e-3
    assert calibration.size(HAND, joints_of(HAND, poses(5))[:, [0, 30]], [0, 30]) == 1  # there is no rigid distance


def test_noisy_joints():
    """With 1 mm of noise per coordinate bones are recovered to about 1%, and the noise is estimated."""
    truth, rng = person(2), np.random.default_rng(2)
    targets = joints_of(truth, poses(200, 2)) + rng.normal(0, MM, (200, 31, 3))
    found = calibrate(HAND, targets, starts=3)
    wrong = errors(found.skeleton, truth)
    assert np.sqrt((wrong**2).mean()) < 0.008 and wrong.max() < 0.025
    assert found.noise == pytest.approx(MM, rel=0.03)
    off = np.abs(found.skeleton.bones - truth.bones)[BONES] / found.bone_deviation[BONES]
    assert 0.2 < np.sqrt((off**2).mean()) < 1.5  # the reported deviation matches the errors


def test_fourteen_joints():
    """Bones between annotated joints are recovered; undetermined bones are reported and stay near the template."""
    truth = person(4)
    joints = list(EVALUATION_JOINTS)
    targets = joints_of(truth, poses(120, 4))[:, joints]
    found = calibrate(HAND, targets, joints, starts=4)
    assert np.mean(found.after) < 0.1 * MM < np.mean(found.before) / 10
    observable = [HAND.joint_names.index(n) for n in ("wrist_left", "wrist_middle", "thumb_dip", "thumb_tip")]
    assert np.allclose(found.skeleton.bones[observable], truth.bones[observable], rtol=5e-3)
    ends = {f"{finger}_{part}" for finger in ("little", "ring", "middle", "index") for part in ("dip", "tip")}
    assert ends <= set(found.undetermined_bones)
    blind = [HAND.joint_names.index(name) for name in ends]
    assert np.allclose(found.skeleton.bones[blind], found.start.bones[blind], rtol=0.15)


def test_joints_that_were_not_seen(exact):
    """Missing fingertips in half of the frames affect only their own residuals."""
    truth, targets, _ = exact
    hidden = targets[:60].copy()
    hidden[::2, [0, 5, 10, 15]] = np.nan
    found = calibrate(HAND, hidden, starts=4)
    assert errors(found.skeleton, truth).max() < 2e-3
    assert np.isnan(found.after[::2, 10]).all() and np.nanmax(found.after) < 0.1 * MM


def test_several_people():
    """Frames of different people leave a large residual, because no single hand fits them."""
    hands = BodySampler().draw(np.random.default_rng(5), 60)
    assert np.mean(calibrate(HAND, hands.joints, starts=2).after) > 1.5 * MM


def test_threads_change_nothing(exact, keep_threads, monkeypatch):
    """Results for one and two threads are equal bit for bit."""
    monkeypatch.setattr(calibration_problem, "CHUNK", 8)
    _, targets, _ = exact
    results = []
    for count in (1, 2):
        netlib.set_threads(count)
        results.append(calibrate(HAND, targets[:40], starts=2))
    assert np.array_equal(results[0].skeleton.bones, results[1].skeleton.bones)
    assert np.array_equal(results[0].inputs, results[1].inputs)


def test_a_file_gives_the_skeleton_back(exact, tmp_path):
    """The written skeleton is read back with equal numbers, names and joints, after its comment."""
    found = exact[2].skeleton
    path = tmp_path / "me.prototxt"
    path.write_text(text_of(found.param, "me", "From 100 frames.\nUnits."), encoding="utf-8")
    again = skeleton.load(path)
    assert again.name == "me" and path.read_text().startswith('# From 100 frames.\n# Units.\nname: "me"\n')
    for field in ("initial", "lower", "upper", "fixed", "bones", "bone_axes", "parents"):
        assert np.array_equal(getattr(again, field), getattr(found, field)), field
    assert again.param.joint == found.param.joint
    inputs = poses(5)
    assert np.array_equal(joints_of(again, inputs), joints_of(found, inputs))


@pytest.mark.parametrize("name", ["nyu", "icvl"])
def test_packaged_hands_as_text(name):
    """Packaged hands survive writing and reading, as do numbers without limits and unusual names."""

    def body(text):
        return skeleton.Skeleton(schema.read(prototxt.parse(text), SkeletonParameter, "test"))

    packaged = skeleton.load(skeleton.NYU_HAND.with_name(f"{name}.prototxt"))
    assert body(text_of(packaged.param, name, "")).param == packaged.param
    odd = body(
        'dof { name: "a \\"b\\"\\n" lower: -1e9 } joint { name: "é" rotate { axis: NEG_X dof: "a \\"b\\"\\n" } }'
    )
    assert body(text_of(odd.param, "", "")).param == odd.param
