"""handpose/frames/formats/frame_names.py: the order of frames and their times, from file names."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.frames.formats.frame_names import in_order
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs

NANO = 10**9


@pytest.mark.parametrize(
    ("names", "times", "ticks", "interpretation"),
    [
        (["10.png", "9.png", "007.png"], (0, 2, 3), 0, "names; numbers missing between 7 and 10: 1, which"),
        (["a_1_depth.png", "a_2_depth.png"], (0, 1), 0, "numbers"),
        (["cam0_00000000000000000001.png", "cam0_00000000000000000003.png"], (0, 2), 0, "numbers"),
        (["20210326-230536_110.png", "20210326-230536_30.png"], (0, 80), 0, "numbers"),
        ([f"v1.{n}.png" for n in range(98, 102)], tuple(range(4)), 0, "numbers"),
        (["background.png"], (0,), 0, "numbers"),
        (["z_34512.png", "z_34545.png"], (0, 33), 0, "(--time-unit if they are times)"),
        (["frame1616799936.png", "frame1616799938.png"], (0, 2 * NANO), NANO, "in s since 1970"),
        (["1616799936125.png", "1616799936158.png"], (0, 33 * 10**6), NANO, "in ms since 1970: a frame every 33 ms"),
        (["1616799936125000.png", "1616799936158000.png"], (0, 33 * 10**6), NANO, "in us since 1970"),
        (["1616799936125000000.png", "1616799936125000007.png"], (0, 7), NANO, "in ns since 1970"),
        (["1305031102.5.png", "1305031102.160407.png"], (0, 339593000), NANO, "in s since 1970"),
        (["x_Depth_1546543216654.25000000000000.png", "x_Depth_1546543216687.50000000000000.png"], (0, 33250000), NANO,
         "in ms since 1970"),
        (["1750000000_933000.png", "1750000001_000000.png"], (0, 67 * 10**6), NANO, "in s since 1970"),
        (["00012_1750000000033.png", "00013_1750000000066.png"], (0, 33 * 10**6), NANO, "in ms since 1970"),
        (["1750000000033_7.png", "1750000000066_8.png"], (0, 33 * 10**6), NANO, "in ms since 1970"),
        (["000000000000us.png", "000000033333us.png"], (0, 33333), 10**6, "in us: a frame every 33.3 ms"),
        (["d7ms.png", "d10ms.png"], (0, 3), 1000, "in ms"),
        (["f1_t0msec.png", "f2_t33msec.png"], (0, 33), 1000, "in ms"),
        (["20210326-230559.png", "20210326-230601.png"], (0, 1), 0, "the order of the dates in their names"),
        (["2021-12-31_23-59-59-750.png", "2022-01-01_00-00-00-000.png"], (0, 1), 0, "dates"),
        (["20211231235959999999.png", "20220101000000000000.png"], (0, 1), 0, "dates"),
        ([f"20251103_0915{42 + s}_{i}.png" for s in (0, 1) for i in range(9, 12)], tuple(range(6)), 0, "dates"),
    ],
)
def test_what_names_tell(names: list[str], times: tuple[int, ...], ticks: int, interpretation: str) -> None:
    """Numbers, and times with a known unit, relative to the first frame."""
    found = in_order(names, "here")
    assert (found.times, found.ticks) == (times, ticks)
    assert interpretation in found.interpretation
    assert sorted(found.names) == sorted(names)


@pytest.mark.parametrize(
    ("names", "unit", "times", "ticks"),
    [
        (["100.png", "180.png", "130.png"], "ms", (0, 30 * 10**6, 80 * 10**6), NANO),
        (["3_17.png", "4_40.png", "5_93.png"], "ms", (0, 23 * 10**6, 76 * 10**6), NANO),
        (["17_3.png", "40_4.png", "93_5.png"], "ms", (0, 23 * 10**6, 76 * 10**6), NANO),
        (["1.5.png", "2.25.png"], "s", (0, 750 * 10**6), NANO),
        (["51234.5000.png", "51267.8333.png"], "ms", (0, 33333300), NANO),
        (["z_34512.png", "z_34545.png"], "frames", (0, 33), 0),
        (["1_1750000000000.png", "2_1750000000033.png"], "frames", (0, 1), 0),
    ],
)
def test_a_given_unit(names: list[str], unit: str, times: tuple[int, ...], ticks: int) -> None:
    found = in_order(names, "here", unit)
    assert (found.times, found.ticks) == (times, ticks)


def test_natural_order() -> None:
    assert in_order(["10.png", "9.png", "08.png"], "here").names == ("08.png", "9.png", "10.png")


@bad_inputs(DataError, {
    "the same number": (["1.png", "001.png"],
                        "here: 001.png and 1.png are frames of the same moment; remove one of them"),
    "two letters": (["a_1.png", "a_2.png", "b_1.png"],
                    "here: holds 2 sequences: a_*.png (2), b_*.png (1); name one, as 'here/a_*.png'"),
    "two kinds": (["1.png", "2.tif"], "here: holds 2 sequences: *.png (1), *.tif (1); name one, as 'here/*.png'"),
    "a background": (["1.png", "background.png"],
                     "here: holds 2 sequences: *.png (1), background.png (1); name one, as 'here/*.png'"),
    "eight letters": ([f"{kind}_1.png" for kind in "abcdefgh"],
                      "here: holds 8 sequences: a_*.png (1), ..., f_*.png (1) and 2 more; name one, as 'here/a_*.png'"),
    "two takes": ([f"take{take}_{i:03}.png" for take in (1, 2) for i in (1, 2)],
                  "here: holds 2 sequences: take1_*.png (2), take2_*.png (2); name one, as 'here/take1_*.png'"),
    "two dated takes": ([f"{take}_2021-03-26_23-05-{i}.png" for take in (1, 2) for i in (36, 37)],
                        "here: holds 2 sequences: 1_2021-03-26_23-05-*.png (2), ..."),
    "two cameras": ([f"cam{camera}_{i:03}_{1750000000000 + 33 * i}.png" for camera in (1, 2) for i in range(3)],
                    "here: holds 2 sequences: cam1_*_*.png (3), cam2_*_*.png (3); name one, as 'here/cam1_*_*.png'"),
    "two sides": ([f"{side}_{i:03}_{1750000000000 + 33 * i}.png" for side in ("left", "right") for i in range(3)],
                  "here: holds 2 sequences: left_*_*.png (3), right_*_*.png (3); name one, as 'here/left_*_*.png'"),
})
def test_names_that_tell_nothing(given: list[str], rejected: Any) -> None:
    """Ambiguous or invalid names raise an error with the reason."""
    with rejected:
        in_order(given, "here")


@given(st.sets(st.integers(0, 10**12), min_size=1, max_size=20), st.integers(0, 15))
def test_any_numbers(numbers: set[int], width: int) -> None:
    """Numbers, with and without leading zeros, are in order, and gaps are kept."""
    found = in_order([f"f{number:0{width}}.png" for number in numbers], "here")
    first = min(numbers)
    assert found.times == tuple(sorted(number - first for number in numbers))


@given(st.lists(st.text(min_size=1, max_size=8), min_size=1, max_size=6))
def test_any_names(names: list[str]) -> None:
    """Any names are either put in a strict order, or raise a DataError."""
    try:
        found = in_order({f"{name.replace('/', '')}.png" for name in names}, "here")
    except DataError:
        return
    assert all(a < b for a, b in itertools.pairwise(found.times))
