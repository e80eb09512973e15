"""handpose/frames/formats/name_times.py: a count and a time in one name, two clocks, and times of a given unit."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from handpose.frames.formats.name_times import reading

MS = [1_750_000_000_000 + round(33.3333 * i) for i in range(8)]
CLOCK = [51234 + 33.3333 * i for i in range(8)]


@pytest.mark.parametrize(
    "name",
    [
        lambda i: f"{i:05}_{MS[i]}",
        lambda i: f"{MS[i]}_{i:05}",
        lambda i: f"z{i:03}_{MS[i] / 1000:.6f}",
        lambda i: f"d{i}-{MS[i] * 1000}",
        lambda i: f"{MS[i] * 10**6}_{i + 7}_depth",
        lambda i: f"{MS[i] // 1000}_{MS[i] % 1000:03}",
        lambda i: f"{MS[i] // 1000}_{MS[i] % 1000 * 10**6:09}",
        lambda i: f"{MS[i] // 1000}-{MS[i] % 1000 * 10**6}",
        lambda i: f"{i}_{MS[i] // 1000}_{MS[i] % 1000 * 1000:06}",
        lambda i: f"z_{int(CLOCK[i])}",
        lambda i: f"{CLOCK[i]:.4f}",
        lambda i: f"{CLOCK[i]:.1f}_{i}",
        lambda i: f"{i:06}_{CLOCK[i]:.4f}",
        lambda i: f"{i + 1:06}_{CLOCK[i]:.0f}",
        lambda i: f"{1000 * CLOCK[i]:.0f}_z{i:06}",
        lambda i: f"{i}_{1e6 * CLOCK[i]:.0f}_{MS[i] // 1000}",
        lambda i: f"f{i:04}_t{33.3333 * i:.0f}ms",
        lambda i: f"{i}_{33.3333 * i:.0f}msec_depth",
        lambda i: f"{i}_{CLOCK[i] / 1000:.3f}s",
        lambda i: f"20250615_1506{40 + (MS[i] - MS[0]) // 1000}_{CLOCK[i]:.0f}",
    ],
)
def test_times_beside_other_numbers(name: Callable[[int], str]) -> None:
    """A time is found among counts, second clocks and dates; the rest of the names is without it."""
    found = reading([name(i) for i in range(8)])
    assert found is not None and found.ticks
    steps = [(time - found.times[0]) / found.ticks for time in found.times]
    assert steps == pytest.approx([i / 30 for i in range(8)], abs=0.0011)


@pytest.mark.parametrize(
    "stems",
    [
        ["take1_001", "take1_002", "take2_001", "take2_002"],
        [f"take{take}_{time}" for take in (1, 2) for time in MS[4 * take - 4 : 4 * take]],
        [f"cam{camera}_{i:05}_{MS[i]}" for camera in (0, 1) for i in range(8)],
        ["a_1", "b_2"],
        ["1", "background"],
    ],
)
def test_several_sequences(stems: list[str]) -> None:
    """Names with another number or text that differs are several sequences."""
    assert reading(stems) is None


@pytest.mark.parametrize(
    ("stems", "unit", "times", "ticks"),
    [
        (["100", "180", "130"], "ms", [100, 180, 130], 1000),
        (["3_17", "4_40", "5_93"], "ms", [17, 40, 93], 1000),
        (["17_3", "40_4", "93_5"], "ms", [17, 40, 93], 1000),
        (["1.5", "2.25"], "s", [1_500_000_000, 2_250_000_000], 10**9),
        (["1.5", "2.25"], "ms", [1_500_000, 2_250_000], 10**9),
        (["z_34512", "z_34545", "z_34578"], "frames", [34512, 34545, 34578], 0),
        (["20210326230536", "20210326230537"], "us", [20210326230536, 20210326230537], 10**6),
        (["1_1750000000000", "2_1750000000033"], "frames", [1, 2], 0),
    ],
)
def test_a_given_unit(stems: list[str], unit: str, times: list[int], ticks: int) -> None:
    """A given unit replaces all inference."""
    found = reading(stems, unit)
    assert found is not None and (found.times, found.ticks) == (times, ticks)
    assert "as given" in found.how or unit in ("s", "frames")
