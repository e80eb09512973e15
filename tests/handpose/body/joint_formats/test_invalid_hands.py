"""handpose/body/joint_formats and handpose/body/gestures: joints that are no hand raise DataError,
never give NaN.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from handpose.body.gestures import GestureReader, scores
from handpose.body.joint_formats.angles import anatomical_angles
from handpose.body.joint_formats.formats import FORMAT_NAMES, FormatName, formatted
from handpose.body.joint_formats.frames import palm_frame
from netlib.blob import Array
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.tracked_hands import CAMERA, HEADER, tracked

SKELETON = HEADER.skeleton
XYZ = tracked().xyz
NAMES = list(SKELETON.joint_names)


def numbers_of(name: FormatName, xyz: Any) -> list[float]:
    """All numbers of a hand in a format."""
    found = formatted(name, SKELETON, "right", xyz, CAMERA)
    arrays = [found.positions] if found.landmarks is None else [found.positions, found.landmarks]
    return [float(number) for array in arrays for number in array.ravel()]


CALLS: dict[str, Callable[[Any], Any]] = {
    "angles": lambda xyz: list(anatomical_angles(SKELETON, "left", xyz).values()),
    "palm": lambda xyz: palm_frame(xyz, SKELETON),
    "scores": lambda xyz: list(scores(SKELETON, "right", xyz).values()),
    "gestures": lambda xyz: GestureReader(SKELETON).read(1, "right", xyz, 0.0).confidence,
    **{name: functools.partial(numbers_of, name) for name in FORMAT_NAMES},
}


def moved(joint: str, to: str) -> Array:
    """The hand with a joint at the position of another."""
    xyz = XYZ.copy()
    xyz[NAMES.index(joint)] = xyz[NAMES.index(to)]
    return xyz


def with_value(value: float) -> Array:
    xyz = XYZ.copy()
    xyz[NAMES.index("ring_tip"), 1] = value
    return xyz


POSITION = (
    "joint 'ring_tip' at [-0.24..., {}, 574...]; expected finite numbers of mm, at most 1e+06"
)


@pytest.mark.parametrize("call", CALLS)
@bad_inputs(
    DataError,
    {
        **{
            str(value): (with_value(value), POSITION.format(value))
            for value in (np.nan, np.inf, 1e300)
        },
        **{
            name: (
                xyz,
                f"joints of shape {np.shape(xyz)}; expected (31, 3), those of skeleton 'people'",
            )
            for name, xyz in (
                ("short", XYZ[:-1]),
                ("2-D", XYZ[:, :2]),
                ("batch", XYZ[None]),
                ("flat", XYZ.ravel()),
                ("None", None),
                ("empty", np.zeros((0, 3))),
            )
        },
        **{
            text: (xyz, f"joints are not numbers: could not convert string to float: {text!r}")
            for text, xyz in (("hand", "hand"), ("x", [["x"]]))
        },
    },
)
def test_invalid_joint_positions_are_rejected(call: str, given: Any, rejected: Any) -> None:
    with rejected:
        CALLS[call](given)


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize(
    "xyz",
    [
        XYZ * 0 + 500,
        XYZ * [1, 0, 0] + [0, 0, 500],
        XYZ * [1, 1, 0] + [0, 0, 500],
        XYZ * 1e-30 + [0, 0, 500],
        moved("index_tip", "index_pip_b"),
        moved("thumb_tip", "thumb_dip"),
        moved("middle_mcp", "wrist_middle"),
        moved("wrist_middle", "wrist_left"),
        moved("little_mcp", "index_mcp"),
        XYZ - [0, 0, 2000],
        np.random.default_rng(0).normal(0, 100, XYZ.shape) + [0, 0, 500],
    ],
    ids=[
        "point",
        "line",
        "plane",
        "tiny",
        "no bone",
        "no thumb bone",
        "no palm",
        "wrist",
        "knuckles",
        "behind",
        "random",
    ],
)
def test_degenerate_hands(call: str, xyz: Array) -> None:
    """A degenerate hand raises DataError, or gives finite values; nothing warns."""
    try:
        assert np.isfinite(np.asarray(CALLS[call](xyz), np.float64)).all()
    except DataError as error:
        assert "expected" in str(error)


@bad_inputs(
    DataError,
    dict.fromkeys(
        ("angles", "scores", "gestures"),
        "the wrist and the knuckles of index and little finger are on a line; expected a palm",
    ),
)
def test_one_point_has_no_directions(given: str, rejected: Any) -> None:
    """Directions, angles and gestures need a palm; positions of a format do not."""
    with rejected:
        CALLS[given](XYZ * 0 + 500)
    assert np.isfinite(CALLS["mano"](XYZ * 0 + 500)).all()


def read_at(time: float) -> Callable[[], object]:
    """A function that reads gestures at this time after one at 1 s."""
    reader = GestureReader(SKELETON)
    reader.read(1, "right", XYZ, 1.0)
    return lambda: reader.read(1, "right", XYZ, time)


@bad_inputs(
    DataError,
    {
        "side": (
            lambda: anatomical_angles(SKELETON, "both", XYZ),
            "hand 'both'; expected right or left",
        ),  # type: ignore[arg-type]
        "format": (
            lambda: formatted("manos", SKELETON, "left", XYZ),  # type: ignore[arg-type]
            "format 'manos' (did you mean 'mano'?); expected mediapipe, mano, nyu",
        ),
        **{
            f"{time} s": (
                read_at(time),
                f"hand 1 at {time} s after 1 s; expected finite times that do not descend",
            )
            for time in (0.5, np.nan, np.inf)
        },
    },
)
def test_other_arguments(given: Callable[[], object], rejected: Any) -> None:
    with rejected:
        given()
