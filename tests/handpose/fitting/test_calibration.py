"""A person's hand from annotated frames: known hands are found again, and what cannot be found is said."""

import dataclasses

import h5py
import numpy as np
import pytest

import netlib
from handpose import calibrate as calibration
from handpose.calibrate import Problem, State, calibrate, read_annotation, rebuilt, skeleton_text
from handpose.nyu import EVALUATION_JOINTS
from handpose.synthetic import Generator
from layers import kinematics
from netlib import prototxt, schema
from netlib.errors import DataError

HAND = kinematics.load()
BONES = np.flatnonzero(HAND.bone_axes >= 0)
MM = 1 / 150  # in half-cubes


def person(seed):
    """A hand with bones up to 15% longer or shorter than the packaged one's, and fixed angles up to 0.1 rad away."""
    rng = np.random.default_rng(seed)
    bones = HAND.bones * rng.uniform(0.85, 1.15, len(HAND.bones))
    dofs = [dataclasses.replace(d, initial=d.initial + d.fixed * rng.uniform(-0.1, 0.1)) for d in HAND.param.dof]
    return rebuilt(HAND.param, dofs, bones)


def poses(count, seed=0):
    return Generator(seed=seed).hands(np.random.default_rng(seed), count).inputs


def errors(skeleton, truth):
    """Relative errors of the 30 bones."""
    return np.abs(skeleton.bones[BONES] / truth.bones[BONES] - 1)


def body(text):
    return kinematics.Skeleton(schema.read(prototxt.parse(text), kinematics.SkeletonParameter, "test"))


@pytest.fixture(scope="module")
def exact():
    """A person, 150 frames of it, and what is found from all joints."""
    truth = person(1)
    targets = truth.joints(poses(150))
    return truth, targets, calibrate(HAND, targets)


# ------------------------------------------------------------------------------------------------ known hands


def test_exact_joints_give_the_hand_back(exact):
    """Bones to 0.1%, joints to 0.02 mm; the template was 9% and 3 mm away."""
    truth, targets, found = exact
    assert errors(found.start, truth).max() > 0.08 and np.mean(found.before) > 2 * MM
    assert errors(found.skeleton, truth).max() < 1e-3
    assert np.allclose(found.skeleton.joints(found.inputs), targets, atol=0.02 * MM)
    assert np.allclose(found.after, np.linalg.norm(found.skeleton.joints(found.inputs) - targets, axis=2))
    assert found.undetermined_bones == [] and (found.bone_deviation[BONES] < 0.3 * MM).all()


def test_the_null_directions_stay_at_the_template(exact):
    """The twist of both points of the wrist moves nothing; the palm's own frame is a matter of convention."""
    _, _, found = exact
    assert found.undetermined_angles == ["wrist_left_rot_y", "wrist_middle_rot_y"]
    for name in found.undetermined_angles:
        dof = HAND.dof_names.index(name)
        assert found.skeleton.initial[dof] == pytest.approx(HAND.initial[dof], abs=1e-6)
    assert np.abs(found.skeleton.initial - HAND.initial)[HAND.fixed].max() < 0.3


def test_initial_pose_and_limits(exact):
    """Inputs have the median 0, their percentiles are the limits; the palm's stay without limits."""
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
    """From distances within the palm; a hand of another size and unit is found as well."""
    truth, targets, found = exact
    assert found.scale == pytest.approx(calibration.size(HAND, targets, range(31)))
    assert calibration.size(HAND, HAND.joints(poses(5)) * 0.7, range(31)) == pytest.approx(0.7)
    in_mm = calibrate(HAND, targets[:60] * 150, starts=4)
    assert errors(in_mm.skeleton, calibration.scaled(truth, 150)).max() < 2e-3
    assert calibration.size(HAND, HAND.joints(poses(5))[:, [0, 30]], [0, 30]) == 1  # no rigid distance


@pytest.mark.parametrize("seed", [2, 3])
def test_noisy_joints(seed):
    """1 mm of noise on every coordinate: bones to about 1%, and the noise is known."""
    truth, rng = person(seed), np.random.default_rng(seed)
    targets = truth.joints(poses(400, seed)) + rng.normal(0, MM, (400, 31, 3))
    found = calibrate(HAND, targets, starts=3)
    wrong = errors(found.skeleton, truth)
    assert np.sqrt((wrong**2).mean()) < 0.008 and wrong.max() < 0.025
    assert found.noise == pytest.approx(MM, rel=0.03)
    off = np.abs(found.skeleton.bones - truth.bones)[BONES] / found.bone_deviation[BONES]
    assert 0.2 < np.sqrt((off**2).mean()) < 1.5  # the deviation that is told is a fair one


def test_fourteen_joints():
    """Bones between annotated joints are found, bones that no joint sees are named and stay near the template."""
    truth = person(4)
    joints = list(EVALUATION_JOINTS)
    targets = truth.joints(poses(200, 4))[:, joints]
    found = calibrate(HAND, targets, joints, starts=4)
    assert np.mean(found.after) < 0.1 * MM < np.mean(found.before) / 10
    observable = [HAND.joint_names.index(n) for n in ("wrist_left", "wrist_middle", "thumb_dip", "thumb_tip")]
    assert np.allclose(found.skeleton.bones[observable], truth.bones[observable], rtol=5e-3)
    ends = {f"{finger}_{part}" for finger in ("little", "ring", "middle", "index") for part in ("dip", "tip")}
    assert ends <= set(found.undetermined_bones)
    blind = [HAND.joint_names.index(name) for name in ends]
    assert np.allclose(found.skeleton.bones[blind], found.start.bones[blind], rtol=0.15)


def test_joints_that_were_not_seen(exact):
    """Tips missing in half of the frames change nothing but the residual there."""
    truth, targets, _ = exact
    hidden = targets.copy()
    hidden[::2, [0, 5, 10, 15]] = np.nan
    found = calibrate(HAND, hidden, starts=4)
    assert errors(found.skeleton, truth).max() < 2e-3
    assert np.isnan(found.after[::2, 10]).all() and np.nanmax(found.after) < 0.1 * MM


def test_several_people():
    """No hand fits frames of different people: the residual says so."""
    hands = Generator(seed=5).hands(np.random.default_rng(5), 100)
    assert np.mean(calibrate(HAND, hands.joints, starts=2).after) > 1.5 * MM


def test_threads_change_nothing(exact, keep_threads, monkeypatch):
    """Bit for bit."""
    monkeypatch.setattr(calibration, "CHUNK", 8)
    _, targets, _ = exact
    results = []
    for count in (1, 2):
        netlib.set_threads(count)
        results.append(calibrate(HAND, targets[:40], starts=2))
    assert np.array_equal(results[0].skeleton.bones, results[1].skeleton.bones)
    assert np.array_equal(results[0].inputs, results[1].inputs)


# ------------------------------------------------------------------------------------------------ mathematics

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


def random_problem(skeleton, joints, frames, rng):
    """A problem with joints missing, and a state away from the template."""
    goal = rng.normal(0, 0.3, (frames, len(joints), 3))
    goal[0, 0] = np.nan
    problem = Problem(skeleton, goal, joints)
    shared = rng.normal(0, 0.5, len(problem.spread))
    return problem, State(problem.state(np.zeros((frames, len(skeleton.initial)))).theta + rng.normal(
        0, 0.4, (frames, len(problem.free))), shared)  # fmt: skip


@pytest.mark.parametrize(
    ("skeleton", "joints"), [(HAND, range(31)), (HAND, EVALUATION_JOINTS), (body(COUPLED), [2, 0])]
)
def test_derivative_against_differences(skeleton, joints, rng):
    """Of poses, fixed angles and bones; also of DoFs that turn two joints."""
    problem, state = random_problem(skeleton, joints, 3, rng)
    every, h = slice(0, 3), 1e-6
    J, r = problem.derivative(state, every)
    F, S = len(problem.free), len(problem.spread)
    assert J.shape == (3, F + S, 3 * len(joints)) and not r[0, :3].any()

    def residual(theta, shared):
        moved = State(state.theta + theta, state.shared + shared)
        return problem.residual(problem.open.forward(*problem.body(moved, every)).joints, every)

    for k in range(F + S):
        step = h * np.eye(F + S)[k]
        slope = (residual(step[:F], step[F:]) - residual(-step[:F], -step[F:])) / (2 * h)
        assert np.allclose(J[:, k], slope, atol=1e-8), k


def test_the_open_skeleton_is_the_template(rng):
    """With the shared numbers at 0 it has the template's joints."""
    problem, _ = random_problem(HAND, range(31), 4, rng)
    inputs = rng.normal(0, 0.3, (4, 47))
    found = problem.open.forward(*problem.body(problem.state(inputs), slice(None))).joints.transpose(2, 0, 1)
    assert np.allclose(found, HAND.joints(inputs))


@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_a_step_solves_the_whole_system(rng, mu, monkeypatch):
    """The reduced equations give the solution of the large ones, in which all poses stand beside all shared numbers."""
    monkeypatch.setattr(calibration, "CHUNK", 2)
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


# ------------------------------------------------------------------------------------------------ files


def test_a_file_gives_the_skeleton_back(exact, tmp_path):
    """All numbers, names and joints; the comment stands above."""
    found = exact[2].skeleton
    path = tmp_path / "me.prototxt"
    path.write_text(skeleton_text(found, "me", "From 150 frames.\nUnits."), encoding="utf-8")
    again = kinematics.load(path)
    assert again.name == "me" and path.read_text().startswith('# From 150 frames.\n# Units.\nname: "me"\n')
    for field in ("initial", "lower", "upper", "fixed", "bones", "bone_axes", "parents"):
        assert np.array_equal(getattr(again, field), getattr(found, field)), field
    assert again.param.joint == found.param.joint
    inputs = poses(5)
    assert np.array_equal(again.joints(inputs), found.joints(inputs))


@pytest.mark.parametrize("name", ["nyu", "icvl"])
def test_packaged_hands_as_text(name):
    """Written and read they are the same; numbers without limits, infinite ones and odd names too."""
    packaged = kinematics.load(kinematics.NYU_HAND.with_name(f"{name}.prototxt"))
    assert body(skeleton_text(packaged, name, "")).param == packaged.param
    odd = body(
        'dof { name: "a \\"b\\"\\n" lower: -1e9 } joint { name: "é" rotate { axis: NEG_X dof: "a \\"b\\"\\n" } }'
    )
    assert body(skeleton_text(odd, "", "")).param == odd.param


def write(path, joints, **more):
    with h5py.File(path, "w") as file:
        file["joint"] = np.asarray(joints, np.float32).reshape(len(joints), -1)
        for name, values in more.items():
            file[name] = values
    return path


@pytest.fixture(scope="module")
def frames():
    return np.clip(HAND.joints(poses(30)) * 0.8, -1, 1)


def test_annotation_of_a_list(frames, tmp_path):
    """Rows of all files in order, with each frame's cube; joints at the faces of the cube are left out."""
    frames = frames.copy()
    frames[3, 10, 1] = 1
    write(tmp_path / "a.h5", frames[:20], half_cube=np.full(20, 130.5))
    write(tmp_path / "b.h5", frames[20:])
    (tmp_path / "list.txt").write_text("a.h5\nb.h5\n")
    found = read_annotation(tmp_path / "list.txt", HAND, half_cube=125)
    assert found.joints == tuple(range(31)) and found.rows == 30 and found.unseen == 1
    assert found.half_cube.tolist() == [130.5] * 20 + [125] * 10
    assert np.isnan(found.targets[3, 10]).all() and np.isnan(found.targets).sum() == 3
    seen = ~np.isnan(found.targets)
    assert np.allclose(found.targets[seen], frames[seen], atol=1e-7)


def test_some_joints_and_some_frames(frames, tmp_path):
    """14 of 31 joints or all 14 there are; frames are drawn, the same for a seed; those mostly cut off are not used."""
    fourteen = frames[:, EVALUATION_JOINTS]
    for joints, rows in ((14, frames), (None, fourteen), (14, fourteen)):
        found = read_annotation(write(tmp_path / "a.h5", rows), HAND, joints)
        assert found.joints == EVALUATION_JOINTS and np.allclose(found.targets, fourteen, atol=1e-7)
    drawn = [read_annotation(tmp_path / "a.h5", HAND, frames=22, seed=seed).targets for seed in (0, 0, 1)]
    assert len(drawn[0]) == 22 and np.array_equal(drawn[0], drawn[1]) and not np.array_equal(drawn[0], drawn[2])
    cut = frames.copy()
    cut[7, :20] = -1
    assert len(read_annotation(write(tmp_path / "a.h5", cut), HAND).targets) == 29
    icvl = kinematics.load(kinematics.NYU_HAND.with_name("icvl.prototxt"))
    assert read_annotation(write(tmp_path / "a.h5", frames[:, :16]), icvl).joints == tuple(range(16))


def test_files_that_cannot_be_used(frames, tmp_path):
    """One line each."""
    infinite = frames.copy()
    infinite[4, 2, 1] = np.inf
    (tmp_path / "none.txt").write_text("")
    write(tmp_path / "fourteen.h5", frames[:, :14])
    (tmp_path / "mixed.txt").write_text("c.h5\nfourteen.h5\n")
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file["depth"] = np.zeros((3, 2))
    files = {
        "no such file": tmp_path / "gone.h5",
        "list of HDF5 files is empty": tmp_path / "none.txt",
        "no data set 'joint'; it has depth": tmp_path / "empty.h5",
        r"expected \(N, 93\) for 31 joints or \(N, 42\) for 14": write(tmp_path / "a.h5", frames[:, 1:]),
        "b.h5: data set 'joint' is infinite in frame 4": write(tmp_path / "b.h5", infinite),
        "19 of 19 frames have half of their joints within": write(tmp_path / "c.h5", frames[:19]),
        "0 of 30 frames have half": write(tmp_path / "d.h5", frames * 150),
        "some files have 14 joints, others 31; expected as many in all": tmp_path / "mixed.txt",
    }  # fmt: skip
    for message, path in files.items():
        with pytest.raises(DataError, match=f"(?i){message}"):
            read_annotation(path, HAND)
    with pytest.raises(DataError, match="has 14 joints of a skeleton of 31; 31 cannot be taken"):
        read_annotation(tmp_path / "fourteen.h5", HAND, 31)


@pytest.mark.parametrize(
    ("targets", "options", "message"),
    [
        (np.zeros((19, 31, 3)), {}, "19 frames, expected 20 or more"),
        (np.zeros((20, 30, 3)), {}, r"joints of shape \(20, 30, 3\), expected \(N, 31, 3\)"),
        (np.zeros((20, 31, 3)), {}, "joints are all in one place"),
        (np.zeros((20, 1, 3)), {"joints": [31]}, r"joints \[31\], expected numbers from 0 to 30"),
        (np.ones((20, 31, 3)), {"percentile": 50}, "percentile 50, expected at least 0 and less than 50"),
    ],
)
def test_mistakes(targets, options, message):
    """Are named."""
    with pytest.raises(DataError, match=message):
        calibrate(HAND, targets, **options)
