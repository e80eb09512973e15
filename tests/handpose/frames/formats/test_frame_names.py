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
        (["frame1616799936.png", "frame1616799938.png"], (0, 2), 1, "in s since 1970"),
        (["1616799936125.png", "1616799936158.png"], (0, 33), 1000, "in ms since 1970"),
        (["1616799936125000.png", "1616799936158000.png"], (0, 33000), 10**6, "in us since 1970"),
        (["1616799936125000000.png", "1616799936125000007.png"], (0, 7), NANO, "in ns since 1970"),
        (["1305031102.5.png", "1305031102.160407.png"], (0, 339593000), NANO, "in seconds"),
        (["1305031102.5.png", "1305031103.0.png"], (0, NANO // 2), NANO, "in seconds"),
        (["0.0.png", "0.0333.png", "0.1.png"], (0, 33300000, 10**8), NANO, "in seconds"),
        (["left_0.000000.png", "left_0.050000.png"], (0, 50000000), NANO, "in seconds"),
        ([f"v1.{n}.png" for n in range(1, 9)], tuple(range(8)), 0, "numbers"),
        ([f"v1.{n}.png" for n in range(98, 102)], tuple(range(4)), 0, "numbers"),
        (["x_Depth_1546543216654.25000000000000.png", "x_Depth_1546543216687.50000000000000.png"], (0, 33250000), NANO,
         "in ms since 1970"),
        (["000000000000us.png", "000000033333us.png"], (0, 33333), 10**6, "in us"),
        (["d7ms.png", "d10ms.png"], (0, 3), 1000, "in ms"),
        (["20210326-230559.png", "20210326-230601.png"], (0, 2 * NANO), NANO, "dates"),
        (["2021-12-31_23-59-59-750.png", "2022-01-01_00-00-00-000.png"], (0, NANO // 4), NANO, "dates"),
        (["20211231235959999999.png", "20220101000000000000.png"], (0, 1000), NANO, "dates"),
        (["20219931-230559.png", "20219931-230601.png"], (0, 42), 0, "numbers"),
        (["background.png"], (0,), 0, "numbers"),
        (["790154000_depth.png", "790187333_depth.png", "790220667_depth.png"], (0, 33333, 66667), 10**6,
         "in us by their steps: a frame every 33.3 ms"),
        (["790154000_depth.png", "823487000_depth.png", "856821000_depth.png"], (0, 33333000, 66667000), NANO,
         "in ns by their steps: a frame every 33.3 ms"),
        (["cam0_90000.png", "cam0_123000.png", "cam0_192000.png", "cam0_222000.png", "cam0_322000.png"],
         (0, 33000, 102000, 132000, 232000), 10**6, "in us by their steps: a frame every 51 ms"),
        (["5000.png", "5100.png", "5200.png"], (0, 100, 200), 0, "numbers missing between 5000 and 5200"),
        (["1000.png", "2000.png", "3000.png"], (0, 1000, 2000), 0, "numbers missing between 1000 and 3000"),
        ([f"{n}.png" for n in (7, 12207, 31007, 36507, 44307)], (0, 12200, 31000, 36500, 44300), 0, "numbers"),
        (["790154000.png", "790187333.png"], (0, 33333), 0, "numbers"),
        (["z_34512.png", "z_34545.png", "z_34579.png", "z_34612.png", "z_34645.png"], (0, 33, 67, 100, 133), 1000,
         "in ms by their steps: a frame every 33 ms"),
        (["51234.5000.png", "51267.8333.png"], (0, 33333300), NANO, "in ms by their steps: a frame every 33.3 ms"),
        (["00012_1750000000033.png", "00013_1750000000066.png"], (0, 33), 1000, "in ms since 1970"),
        (["1750000000_933.png", "1750000000_966.png", "1750000001_000.png"], (0, 33 * 10**6, 67 * 10**6), NANO,
         "in seconds since 1970"),
    ],
)
def test_what_names_tell(names: list[str], times: tuple[int, ...], ticks: int, interpretation: str) -> None:
    """Numbers, time stamps in any unit and dates are recognised, relative to the first frame."""
    found = in_order(names, "here")
    assert (found.times, found.ticks) == (times, ticks)
    assert interpretation in found.interpretation
    assert sorted(found.names) == sorted(names)


def test_natural_order() -> None:
    """9 comes before 10."""
    assert in_order(["10.png", "9.png", "08.png"], "here").names == ("08.png", "9.png", "10.png")


@bad_inputs(DataError, {
    "the same number": (["1.png", "001.png"],
                        "here: 001.png and 1.png are frames of the same moment; remove one of them"),
    "two letters": (["a_1.png", "a_2.png", "b_1.png"],
                    "here: holds 2 sequences: a_*.png (2), b_*.png (1); name one, as 'here/a_*.png'"),
    "two dates": (["20210326-230536_1.png", "20210326-230536_2.png", "20210326-231615_2.png"],
                  "here: holds 2 sequences: 20210326-230536_*.png (2), 20210326-231615_*.png (1); name one, ..."),
    "seconds that several frames share": ([f"20251103_0915{42 + s}_{i:02}.png" for s in (0, 1) for i in range(30)],
        "here: holds 2 sequences: 20251103_091542_*.png (30), 20251103_091543_*.png (30); name one, ..."),
    "two kinds": (["1.png", "2.tif"], "here: holds 2 sequences: *.png (1), *.tif (1); name one, as 'here/*.png'"),
    "a background": (["1.png", "background.png"],
                     "here: holds 2 sequences: *.png (1), background.png (1); name one, as 'here/*.png'"),
    "eight letters": ([f"{kind}_1.png" for kind in "abcdefgh"],
                      "here: holds 8 sequences: a_*.png (1), ..., f_*.png (1) and 2 more; name one, as 'here/a_*.png'"),
    "40 digits": (["1" * 40 + ".png"],
                  f"here: {'1' * 40}.png: a number of 40 digits; expected a frame's number or time"),
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
