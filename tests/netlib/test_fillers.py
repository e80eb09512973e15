"""Fillers: the distributions of initial weights."""

from __future__ import annotations

import numpy as np
import pytest

from netlib.fillers import Filler, fill

SHAPE = (50, 20, 10, 10)  # fan-in 2000, fan-out 5000


def filled(filler: Filler, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    array = np.full(shape, np.nan)
    fill(array, filler, np.random.default_rng(0))
    return array


@pytest.mark.parametrize(
    ("filler", "mean", "std"),
    [
        (Filler(value=2.5), 2.5, 0),
        (Filler(), 0, 0),
        (Filler("uniform", min=-1, max=3), 1, 4 / np.sqrt(12)),
        (Filler("gaussian", mean=2, std=0.5), 2, 0.5),
        (Filler("xavier"), 0, np.sqrt(1 / 2000)),
        (Filler("xavier", variance_norm="FAN_OUT"), 0, np.sqrt(1 / 5000)),
        (Filler("xavier", variance_norm="AVERAGE"), 0, np.sqrt(1 / 3500)),
        (Filler("msra"), 0, np.sqrt(2 / 2000)),
        (Filler("msra", variance_norm="FAN_OUT"), 0, np.sqrt(2 / 5000)),
        (Filler("msra", variance_norm="AVERAGE"), 0, np.sqrt(2 / 3500)),
    ],
    ids=lambda value: f"{value.type} {value.variance_norm}" if isinstance(value, Filler) else "",
)
def test_mean_and_deviation(filler: Filler, mean: float, std: float) -> None:
    array = filled(filler)
    assert abs(array.mean() - mean) <= 5 * std / np.sqrt(array.size)
    assert array.std() == pytest.approx(std, rel=0.02)


def test_bounds() -> None:
    assert -1 <= filled(Filler("uniform", min=-1, max=3)).min() < -0.99
    bound = np.sqrt(3 / 2000)
    assert 0.99 * bound < np.abs(filled(Filler("xavier"))).max() <= bound


@pytest.mark.parametrize(("shape", "fan_in"), [((100, 10), 10), ((10, 100), 100), ((5000,), 1)])
def test_the_fan_in_is_count_by_outputs(shape: tuple[int, ...], fan_in: int) -> None:
    """The fan-in is count / shape[0], regardless of the meaning of the axes, as in Caffe."""
    assert np.abs(filled(Filler("xavier"), shape)).max() == pytest.approx(
        np.sqrt(3 / fan_in), rel=0.01
    )


def test_sparse_gaussian() -> None:
    """``sparse: 5`` leaves about 5 nonzero weights for an input that goes to 50 outputs."""
    array = filled(Filler("gaussian", sparse=5))
    assert np.mean(array != 0) == pytest.approx(5 / 50, rel=0.05)


def test_positive_unitball() -> None:
    array = filled(Filler("positive_unitball"))
    assert (array > 0).all()
    assert np.allclose(array.reshape(50, -1).sum(axis=1), 1)


def test_bilinear() -> None:
    """The kernel upsamples: width 4 is factor 2, with the line 1/4, 3/4, 3/4, 1/4."""
    line = np.array([0.25, 0.75, 0.75, 0.25])
    array = filled(Filler("bilinear"), (2, 1, 4, 4))
    assert np.allclose(array, np.outer(line, line))
