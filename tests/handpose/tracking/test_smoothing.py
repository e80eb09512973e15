"""handpose/tracking/smoothing.py: the paper's formulas, for vectors and rotations; a trembling hand
and a moving one
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handpose.fit.body import CapsuleModel, WorldPose, crop_variables, world_pose
from handpose.fit.pose_confidence import GOOD_MM
from handpose.tracking.settings import Cutoff, SmoothSettings
from handpose.tracking.smoothing import PoseFilter, share

CUTOFF = Cutoff(min_hz=0.8, slope=0.02, speed_hz=1.5)
SEEDS = st.integers(0, 10**6)
FRAMES = np.arange(60) / 30


def alpha(hertz: float, seconds: float) -> float:
    """The weight of a new value in the paper."""
    tau = 1 / (2 * math.pi * hertz)
    return 1 / (1 + tau / seconds)


def by_the_paper(values: np.ndarray, times: np.ndarray, cutoff: Cutoff) -> list[float]:
    """The paper's equations 1 to 5 for scalars: the speed of the raw values is filtered with
    a fixed cutoff.
    """

    out, speed = [values[0]], 0.0
    for i in range(1, len(values)):
        seconds = times[i] - times[i - 1]
        a = alpha(cutoff.speed_hz, seconds)
        speed = a * (values[i] - values[i - 1]) / seconds + (1 - a) * speed
        a = alpha(cutoff.min_hz + cutoff.slope * abs(speed), seconds)
        out.append(a * values[i] + (1 - a) * out[-1])
    return out


def with_noise(
    values: np.ndarray, times: np.ndarray, cutoff: Cutoff, trust: np.ndarray
) -> list[float]:
    """The paper's filter with a bounded noise floor of the speed, the geometric mean of its
    deviations, and gaps.
    """

    out, speed, scatter = [values[0]], 0.0, 1.0
    for i in range(1, len(values)):
        seconds = times[i] - times[i - 1]
        now = (values[i] - values[i - 1]) / seconds
        speed += alpha(cutoff.speed_hz, seconds) * (now - speed)
        # At first, the mean of all deviations so far.
        part = max(alpha(SmoothSettings().scatter_hz, seconds), 1 / i)
        scatter = scatter ** (1 - part) * abs(now - speed) ** part
        excess = max(abs(speed) - min(cutoff.noise * scatter, cutoff.max_noise), 0.0)
        gap = max(abs(values[i] - out[-1]) - cutoff.min_gap, 0.0)
        by_speed = cutoff.min_hz + cutoff.slope * excess
        hertz = trust[i] * by_speed + trust[i] ** 3 * cutoff.gap_slope * gap
        out.append(out[-1] + alpha(hertz, seconds) * (values[i] - out[-1]))
    return out


def uneven(rng: np.random.Generator, count: int = 30) -> np.ndarray:
    """Times of frames, some of which are missing."""
    return np.cumsum(rng.choice([1, 1, 1, 2, 5], count)) / 30


def filtered(
    cutoff: Cutoff,
    times: np.ndarray,
    place: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
    others: np.ndarray | None = None,
    errors_mm: np.ndarray | None = None,
) -> WorldPose:
    """Places (N, 3), rotations (N, 3, 3) and other variables (N, n), filtered; what is
    not given rests.
    """
    count = len(times)
    errors_mm = np.zeros(count) if errors_mm is None else errors_mm
    place = np.zeros((count, 3)) if place is None else place
    rotation = np.tile(np.eye(3), (count, 1, 1)) if rotation is None else rotation
    others = np.zeros((count, 1)) if others is None else others
    one = PoseFilter(SmoothSettings(cutoff, cutoff, cutoff))
    poses = zip(place, rotation, others)
    found = [
        one(WorldPose(*pose), float(time), error)
        for pose, time, error in zip(poses, times, errors_mm)
    ]
    return WorldPose(*(np.array(values) for values in zip(*found)))


def of_values(cutoff: Cutoff, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Variables (N, n), each filtered by its own speed."""
    return filtered(cutoff, times, others=values).others


# ------------------------------------------------------------------------------------------ vectors


@given(seed=SEEDS)
def test_as_in_the_paper(seed: int) -> None:
    """Each variable is filtered as in the paper, at uneven times; so is a place that moves
    along one axis.
    """
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), np.cumsum(rng.normal(0, 20, (30, 3)), axis=0)
    expected = np.transpose([by_the_paper(own, times, CUTOFF) for own in values.T])
    np.testing.assert_allclose(of_values(CUTOFF, values, times), expected)
    along = values[:, :1] * (1, 0, 0)
    np.testing.assert_allclose(filtered(CUTOFF, times, along).place, expected[:, :1] * (1, 0, 0))


@given(seed=SEEDS)
def test_a_point_has_no_axes(seed: int) -> None:
    """With the speed of the point, filtering commutes with rotation; with one speed per
    variable it does not.
    """
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), np.cumsum(rng.normal(0, 20, (30, 3)), axis=0)
    R = Rotation.random(random_state=rng).as_matrix()
    once = filtered(CUTOFF, times, values).place
    np.testing.assert_allclose(filtered(CUTOFF, times, values @ R.T).place, once @ R.T, atol=1e-9)
    by_variable = of_values(CUTOFF, values, times)
    assert not np.allclose(of_values(CUTOFF, values @ R.T, times), by_variable @ R.T)


@given(
    seed=SEEDS,
    noise=st.floats(0, 3),
    most=st.sampled_from([2.0, 30.0, math.inf]),
    gap=st.sampled_from([0.0, 2.0]),
)
def test_noise_is_subtracted_from_the_speed(
    seed: int, noise: float, most: float, gap: float
) -> None:
    """The deviation of the speed is subtracted from it, up to a bound, gaps add to it, and large
    errors count less.
    """
    rng = np.random.default_rng(seed)
    times = uneven(rng)
    values = np.cumsum(rng.normal(0, 2, (30, 3)), axis=0)
    errors = rng.uniform(10, 100, 30)
    cutoff = Cutoff(0.8, 0.5, 1.5, noise, most, gap, min_gap=1.0)
    trust = np.clip((GOOD_MM / errors) ** 3, 0.1, 1)
    expected = np.transpose([with_noise(own, times, cutoff, trust) for own in values.T])
    found = filtered(cutoff, times, others=values, errors_mm=errors).others
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_steadier_at_rest_and_as_quick_in_motion() -> None:
    """With the noise floor the filter trembles much less at rest, and has the same
    lag in motion.
    """
    times = np.arange(300) / 30
    still = np.random.default_rng(0).normal(0, 1, (300, 1))
    plain, floored = Cutoff(0.5, 0.4, 2.7), Cutoff(0.5, 0.4, 2.7, noise=1.3)
    noise, floored_noise = (
        of_values(cutoff, still, times)[60:].std() for cutoff in (plain, floored)
    )
    assert floored_noise < 0.7 * noise and floored_noise < 0.5
    moving = 300 * times[:, None] + still
    lag, floored_lag = (
        np.abs(moving - of_values(cutoff, moving, times))[60:].mean() for cutoff in (plain, floored)
    )
    assert floored_lag < lag + 0.1


def test_a_jump_is_followed_and_jitter_is_not() -> None:
    """A large gap opens the filter in the same frame; gaps of the size of jitter do not."""
    times, slow = np.arange(40) / 30, Cutoff(0.5, 0.0, 1.0)
    quick = Cutoff(0.5, 0.0, 1.0, gap_slope=150.0, min_gap=0.06)
    still = np.random.default_rng(0).uniform(-0.02, 0.02, (40, 1))
    jumping = still + (np.arange(40) >= 20)[:, None]
    np.testing.assert_array_equal(of_values(slow, still, times), of_values(quick, still, times))
    after = [of_values(cutoff, jumping, times)[20, 0] for cutoff in (slow, quick)]
    assert after[0] < 0.15 and after[1] > 0.9


@given(slope=st.floats(0, 100), which=st.sampled_from(["place", "others"]))
def test_a_step_is_approached(slope: float, which: str) -> None:
    """A step is approached monotonically, without overshoot."""
    values = np.where(FRAMES[:, None] > 0.2, [10.0, -4, 0], [0.0, 0, 0])
    found = getattr(filtered(Cutoff(0.8, slope, 1.5), FRAMES, **{which: values}), which)
    assert (np.diff(found[:, 0]) >= 0).all() and (np.diff(found[:, 1]) <= 0).all()
    assert 9 < found[-1, 0] <= 10 and -4 <= found[-1, 1] < -3.6


def test_faster_motion_lags_less() -> None:
    """Without the slope the lag in seconds is constant."""

    def lag(speed: float, slope: float) -> float:
        values = speed * FRAMES[:, None]
        return float((values - of_values(Cutoff(0.8, slope, 1.5), values, FRAMES))[-1, 0] / speed)

    lags = [lag(speed, 0.02) for speed in (10, 100, 1000)]
    assert lags[0] > 1.5 * lags[1] > 3 * lags[2] and lags[2] < 0.03
    assert lag(10, 0) == pytest.approx(lag(1000, 0)) and lag(10, 0) > lags[0]


# ---------------------------------------------------------------------------------------- rotations


@given(seed=SEEDS)
def test_turns_about_one_axis_are_angles(seed: int) -> None:
    """Rotations about one axis are filtered like the angle, also beyond half a turn."""
    rng = np.random.default_rng(seed)
    times, angles = uneven(rng), np.cumsum(rng.uniform(-0.8, 1.0, (30, 1)), axis=0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    cutoff = Cutoff(0.8, 1.0, 1.5)
    expected = of_values(cutoff, angles, times)
    turns = Rotation.from_rotvec(angles * axis).as_matrix()
    found = filtered(cutoff, times, rotation=turns).rotation
    np.testing.assert_allclose(found, Rotation.from_rotvec(expected * axis).as_matrix(), atol=1e-6)


@given(seed=SEEDS)
def test_rotations_have_no_axes(seed: int) -> None:
    """The filter does not depend on the axes of the world or of the body, and its values
    are rotations.
    """
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), [Rotation.random(random_state=rng).as_matrix()]
    for step in rng.uniform(-0.5, 0.5, (29, 3)):
        values.append(Rotation.from_rotvec(step).as_matrix() @ values[-1])
    A, B = Rotation.random(2, random_state=rng).as_matrix()
    once = filtered(CUTOFF, times, rotation=np.array(values)).rotation
    twice = filtered(CUTOFF, times, rotation=A @ np.array(values) @ B).rotation
    np.testing.assert_allclose(twice, A @ once @ B, atol=1e-6)
    identities = np.tile(np.eye(3), (30, 1, 1))
    np.testing.assert_allclose(once @ once.swapaxes(1, 2), identities, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(once), 1)


# -------------------------------------------------------------------------------------------- times


def test_constant_poses_are_unchanged() -> None:
    values = np.tile([3.3, -1e5, 0], (60, 1))
    R = np.tile(Rotation.from_rotvec([2, 1, -2]).as_matrix(), (60, 1, 1))
    found = filtered(CUTOFF, FRAMES, values, R, values)
    np.testing.assert_array_equal(found.place, values)
    np.testing.assert_allclose(found.rotation, R, atol=1e-7)
    np.testing.assert_array_equal(found.others, values)


def test_longer_without_a_frame_counts_more() -> None:
    """After a long time the old value has no weight; a second value at the same time is ignored."""
    assert share(1.0, 1e-9) < 1e-8 and share(1.0, 1e9) > 1 - 1e-8
    assert (np.diff(share(1.0, np.linspace(0.01, 2, 50))) > 0).all()  # type: ignore[arg-type]
    found = of_values(CUTOFF, np.array([[0.0], [1], [9], [5]]), np.array([0, 0.1, 0.1, 1e9]))
    assert found[2] == found[1] > 0
    np.testing.assert_allclose(found[3], 5)


# -------------------------------------------------------------------------------------------- hands

TIMES = np.arange(90) / 30
CENTER = np.array([20.0, -30, 700])


def smoothed(model: CapsuleModel, poses: np.ndarray) -> np.ndarray:
    """Smoothed joints (N, K, 3) in mm, from variables (N, V)."""
    one = PoseFilter(SmoothSettings())
    found = [
        crop_variables(model, one(world_pose(model, x, CENTER), float(time)), CENTER)
        for x, time in zip(poses, TIMES)
    ]
    return model.joints(np.array(found))


def bones(model: CapsuleModel, joints: np.ndarray) -> np.ndarray:
    """Bone lengths (N, K - 1)."""
    child = np.flatnonzero(model.skeleton.parents >= 0)
    return np.linalg.norm(joints[:, child] - joints[:, model.skeleton.parents[child]], axis=2)


@pytest.fixture
def trembling(model: CapsuleModel) -> np.ndarray:
    """Variables (90, V) of a hand at rest, with noise of half a millimetre and 0.004 radians, and a
    constant size.
    """
    off = np.random.default_rng(0).normal(0, 0.004, (len(TIMES), model.variables))
    off[:, :3] *= 0.5 / (150 * 0.004)
    off[:, -2:] = 0
    return off + np.random.default_rng(1).uniform(0, 0.3, model.variables)


def test_a_trembling_hand_becomes_steady(model: CapsuleModel, trembling: np.ndarray) -> None:
    """The deviation is halved at least, the first pose is unchanged, and bones keep
    their lengths.
    """
    raw, found = model.joints(trembling), smoothed(model, trembling)
    np.testing.assert_allclose(found[0], raw[0], atol=1e-6)
    assert found[15:].std(axis=0).max() < 0.5 * raw.std(axis=0).max()
    np.testing.assert_allclose(found[15:].mean(axis=0), raw.mean(axis=0), atol=1)
    same_bones = np.broadcast_to(bones(model, raw[:1]), bones(model, found).shape)
    np.testing.assert_allclose(bones(model, found), same_bones, atol=1e-9)


def test_a_moving_hand_is_not_left_behind(model: CapsuleModel) -> None:
    """At half a metre and half a turn per second, with closing fingers, the lag is
    less than a frame.
    """
    x = np.zeros((len(TIMES), model.variables))
    x[:, 0] = 500 * TIMES / 150
    x[:, 5] = np.pi * TIMES
    x[:, model.limbs] = np.clip(0.5 * TIMES[:, None], 0, 1)
    raw, found = model.joints(x), smoothed(model, x)
    behind = np.linalg.norm(found - raw, axis=2).mean(axis=1)
    way = np.linalg.norm(np.diff(raw, axis=0), axis=2).mean(axis=1)
    assert behind[30:].max() < way[30:].max()


def test_an_uncertain_pose_has_a_small_weight(model: CapsuleModel, trembling: np.ndarray) -> None:
    """A larger expected error gives a smaller weight, which is never 0; an unknown error counts
    as a small one.
    """
    other = trembling[0].copy()
    other[model.limbs] += 0.5
    ways = []
    for error in (float("nan"), 3.0, 30.0, 52.0, 75.0, 600.0):
        one = PoseFilter(SmoothSettings())
        first = one(world_pose(model, trembling[0], CENTER), 0.0, 4.0)
        second = one(world_pose(model, other, CENTER), 1 / 30, error)
        ways.append(np.abs(second.others - first.others).max())
    assert ways[0] == ways[1] == ways[2] > 1.5 * ways[3] > 1.5 * ways[4] > 0
    assert ways[4] == ways[5]
