"""handpose/tracking/smoothing.py: the paper's formulas, for vectors and rotations"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from handpose.tracking.smoothing import SCATTER_HZ, Cutoff, OneEuro, OneEuroRotation, share, turn_between, turned

CUTOFF = Cutoff(least=0.8, slope=0.02, speed=1.5)
SEEDS = st.integers(0, 10**6)
FRAMES = np.arange(60) / 30


def alpha(hertz: float, seconds: float) -> float:
    """The weight of a new value in the paper."""
    tau = 1 / (2 * math.pi * hertz)
    return 1 / (1 + tau / seconds)


def by_the_paper(values: np.ndarray, times: np.ndarray, cutoff: Cutoff) -> list[float]:
    """The paper's equations 1 to 5 for scalars: the speed of the raw values is filtered with a fixed cutoff."""

    out, speed = [values[0]], 0.0
    for i in range(1, len(values)):
        seconds = times[i] - times[i - 1]
        a = alpha(cutoff.speed, seconds)
        speed = a * (values[i] - values[i - 1]) / seconds + (1 - a) * speed
        a = alpha(cutoff.least + cutoff.slope * abs(speed), seconds)
        out.append(a * values[i] + (1 - a) * out[-1])
    return out


def with_noise(values: np.ndarray, times: np.ndarray, cutoff: Cutoff, trust: np.ndarray) -> list[float]:
    """The paper's filter with a bounded noise floor of the speed, the geometric mean of its deviations, and gaps."""

    out, speed, scatter = [values[0]], 0.0, 1.0
    for i in range(1, len(values)):
        seconds = times[i] - times[i - 1]
        now = (values[i] - values[i - 1]) / seconds
        speed += alpha(cutoff.speed, seconds) * (now - speed)
        part = max(alpha(SCATTER_HZ, seconds), 1 / i)  # at first the mean of all deviations so far
        scatter = scatter ** (1 - part) * abs(now - speed) ** part
        excess = max(abs(speed) - min(cutoff.noise * scatter, cutoff.most), 0.0)
        gap = max(abs(values[i] - out[-1]) - cutoff.least_gap, 0.0)
        hertz = trust[i] * (cutoff.least + cutoff.slope * excess) + trust[i] ** 3 * cutoff.gap * gap
        out.append(out[-1] + alpha(hertz, seconds) * (values[i] - out[-1]))
    return out


def uneven(rng: np.random.Generator, count: int = 30) -> np.ndarray:
    """Times of frames, some of which are missing."""
    return np.cumsum(rng.choice([1, 1, 1, 2, 5], count)) / 30


def filtered(one: Callable[[np.ndarray, float], np.ndarray], values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The filtered values."""
    return np.array([one(value, float(time)) for value, time in zip(values, times)])


def turns(rng: np.random.Generator, count: int = 30, size: float = 0.5) -> np.ndarray:
    """Rotations (count, 3, 3), each within ``size`` of the previous one; the first is random."""
    made = [Rotation.random(random_state=rng)]
    for step in rng.uniform(-size, size, (count - 1, 3)) / math.sqrt(3):
        made.append(Rotation.from_rotvec(step) * made[-1])
    return np.array([one.as_matrix() for one in made])


# ------------------------------------------------------------------------------------------------ vectors


@given(seed=SEEDS)
def test_as_in_the_paper(seed: int) -> None:
    """Each element is filtered as in the paper, at uneven times."""
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), np.cumsum(rng.normal(0, 20, (30, 3)), axis=0)
    expected = np.transpose([by_the_paper(own, times, CUTOFF) for own in values.T])
    np.testing.assert_allclose(filtered(OneEuro(CUTOFF), values, times), expected)
    single = filtered(OneEuro(CUTOFF, together=True), values[:, :1], times)
    np.testing.assert_allclose(single, expected[:, :1])


@given(seed=SEEDS)
def test_a_point_has_no_axes(seed: int) -> None:
    """With a common speed, filtering commutes with rotation; with one speed per element it does not."""
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), np.cumsum(rng.normal(0, 20, (30, 3)), axis=0)
    R = Rotation.random(random_state=rng).as_matrix()
    once = filtered(OneEuro(CUTOFF, together=True), values, times)
    np.testing.assert_allclose(filtered(OneEuro(CUTOFF, together=True), values @ R.T, times), once @ R.T, atol=1e-9)
    assert not np.allclose(filtered(OneEuro(CUTOFF), values @ R.T, times),
                           filtered(OneEuro(CUTOFF), values, times) @ R.T)


@given(seed=SEEDS, noise=st.floats(0, 3), most=st.sampled_from([2.0, 30.0, math.inf]), gap=st.sampled_from([0.0, 2.0]))
def test_trembling_is_no_movement(seed: int, noise: float, most: float, gap: float) -> None:
    """The deviation of the speed is subtracted from it, up to a bound, gaps add to it, and values can have weights."""
    rng = np.random.default_rng(seed)
    times, values, trust = uneven(rng), np.cumsum(rng.normal(0, 2, (30, 3)), axis=0), rng.uniform(0.1, 1, 30)
    cutoff = Cutoff(0.8, 0.5, 1.5, noise, most, gap, least_gap=1.0)
    one = OneEuro(cutoff)
    found = np.array([one(value, float(time), float(t)) for value, time, t in zip(values, times, trust)])
    expected = np.transpose([with_noise(own, times, cutoff, trust) for own in values.T])
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_steadier_at_rest_and_as_quick_in_motion() -> None:
    """With the noise floor the filter trembles much less at rest, and has the same lag in motion."""
    times = np.arange(300) / 30
    still = np.random.default_rng(0).normal(0, 1, (300, 1))
    plain, floored = Cutoff(0.5, 0.4, 2.7), Cutoff(0.5, 0.4, 2.7, noise=1.3)
    shaken = [filtered(OneEuro(cutoff), still, times)[60:].std() for cutoff in (plain, floored)]
    assert shaken[1] < 0.7 * shaken[0]
    moving = 300 * times[:, None] + still
    behind = [np.abs(moving - filtered(OneEuro(cutoff), moving, times))[60:].mean() for cutoff in (plain, floored)]
    assert behind[1] < behind[0] + 0.1


def test_a_jump_is_followed_and_jitter_is_not() -> None:
    """A large gap opens the filter in the same frame; gaps of the size of jitter do not."""
    times, slow = np.arange(40) / 30, Cutoff(0.5, 0.0, 1.0)
    quick = Cutoff(0.5, 0.0, 1.0, gap=150.0, least_gap=0.06)
    still = np.random.default_rng(0).uniform(-0.02, 0.02, (40, 1))
    jumping = still + (np.arange(40) >= 20)[:, None]
    np.testing.assert_array_equal(*(filtered(OneEuro(cutoff), still, times) for cutoff in (slow, quick)))
    after = [filtered(OneEuro(cutoff), jumping, times)[20, 0] for cutoff in (slow, quick)]
    assert after[0] < 0.15 and after[1] > 0.9


def test_at_rest_it_stays() -> None:
    """Constant values are unchanged, exactly."""
    values = np.tile([3.3, -1e5, 0], (60, 1))
    np.testing.assert_array_equal(filtered(OneEuro(CUTOFF), values, FRAMES), values)


@given(slope=st.floats(0, 100), together=st.booleans())
def test_a_step_is_approached(slope: float, together: bool) -> None:
    """A step is approached monotonically, without overshoot."""
    values = np.where(FRAMES[:, None] > 0.2, [10.0, -4], [0.0, 0])
    found = filtered(OneEuro(Cutoff(0.8, slope, 1.5), together), values, FRAMES)
    assert (np.diff(found[:, 0]) >= 0).all() and (np.diff(found[:, 1]) <= 0).all()
    assert 9 < found[-1, 0] <= 10 and -4 <= found[-1, 1] < -3.6


def test_what_moves_faster_lags_less() -> None:
    """The lag in seconds is shorter for faster motion; without the slope it is constant."""

    def lag(speed: float, slope: float) -> float:
        values = speed * FRAMES[:, None]
        return float((values - filtered(OneEuro(Cutoff(0.8, slope, 1.5)), values, FRAMES))[-1, 0] / speed)

    lags = [lag(speed, 0.02) for speed in (10, 100, 1000)]
    assert lags[0] > 1.5 * lags[1] > 3 * lags[2] and lags[2] < 0.03
    assert lag(10, 0) == pytest.approx(lag(1000, 0)) and lag(10, 0) > lags[0]


def test_it_trembles_less() -> None:
    """The deviation of noise about a constant is reduced to less than half."""
    values = np.random.default_rng(0).normal(0, 1, (300, 1))
    assert filtered(OneEuro(CUTOFF), values, np.arange(300) / 30)[30:].std() < 0.5


def test_longer_without_a_frame_counts_more() -> None:
    """After a long time the old value has no weight; a second value at the same time is ignored."""
    assert share(1.0, 1e-9) < 1e-8 and share(1.0, 1e9) > 1 - 1e-8
    assert (np.diff(share(1.0, np.linspace(0.01, 2, 50))) > 0).all()  # type: ignore[arg-type]
    one = OneEuro(CUTOFF)
    one(np.zeros(1), 0.0)
    before = one(np.ones(1), 0.1)
    np.testing.assert_array_equal(one(np.full(1, 9.0), 0.1), before)
    np.testing.assert_allclose(one(np.full(1, 5.0), 1e9), 5)


# ---------------------------------------------------------------------------------------------- rotations


@given(seed=SEEDS)
def test_turns_about_one_axis_are_angles(seed: int) -> None:
    """Rotations about one axis are filtered like the angle, also beyond half a turn."""
    rng = np.random.default_rng(seed)
    times, angles = uneven(rng), np.cumsum(rng.uniform(-0.8, 1.0, (30, 1)), axis=0)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    cutoff = Cutoff(0.8, 1.0, 1.5)
    expected = filtered(OneEuro(cutoff), angles, times)
    found = filtered(OneEuroRotation(cutoff), Rotation.from_rotvec(angles * axis).as_matrix(), times)
    np.testing.assert_allclose(found, Rotation.from_rotvec(expected * axis).as_matrix(), atol=1e-6)


@given(seed=SEEDS)
def test_rotations_stay_rotations(seed: int) -> None:
    """Filtered values are rotations, for any jumps."""
    rng = np.random.default_rng(seed)
    found = filtered(OneEuroRotation(CUTOFF), turns(rng, size=3.0), uneven(rng))
    np.testing.assert_allclose(found @ found.swapaxes(1, 2), np.tile(np.eye(3), (30, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found), 1)


@given(seed=SEEDS)
def test_rotations_have_no_axes(seed: int) -> None:
    """The filter does not depend on the axes of the world or of the body."""
    rng = np.random.default_rng(seed)
    times, values = uneven(rng), turns(rng)
    A, B = Rotation.random(2, random_state=rng).as_matrix()
    once = filtered(OneEuroRotation(CUTOFF), values, times)
    np.testing.assert_allclose(filtered(OneEuroRotation(CUTOFF), A @ values @ B, times), A @ once @ B, atol=1e-6)


def test_rotations_at_rest_and_at_one_time() -> None:
    """As for vectors, a constant is unchanged, and a second value at the same time is ignored."""
    R = Rotation.from_rotvec([2, 1, -2]).as_matrix()
    found = filtered(OneEuroRotation(CUTOFF), np.tile(R, (60, 1, 1)), FRAMES)
    np.testing.assert_allclose(found, np.tile(R, (60, 1, 1)), atol=1e-7)
    one = OneEuroRotation(CUTOFF)
    one(R, 0.0)
    np.testing.assert_array_equal(one(np.eye(3), 0.0), R)


@given(seed=SEEDS, angle=st.floats(0, math.pi))
def test_turns_there_and_back(seed: int, angle: float) -> None:
    """``turn_between`` leads from one rotation to the other about an axis of the world, by at most half a turn."""
    rng = np.random.default_rng(seed)
    first = Rotation.random(random_state=rng).as_matrix()
    axis = rng.normal(size=3)
    turn = angle * axis / np.linalg.norm(axis)
    second = turned(first, turn)
    np.testing.assert_allclose(second, Rotation.from_rotvec(turn).as_matrix() @ first, atol=1e-9)
    back = turn_between(first, second)
    assert np.linalg.norm(back) <= math.pi + 1e-9
    np.testing.assert_allclose(turned(first, back), second, atol=1e-5)
