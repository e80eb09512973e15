"""handpose/scoring/published_predictions.py"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.frames.cameras import ICVL, NYU
from handpose.scoring import published_predictions as published
from handpose.scoring.metrics import joint_errors
from handpose.scoring.published_predictions import Format, Score, compare_angles
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tests.handpose.conftest import SHARED
from tests.support.bad_input import bad_inputs

LINE = "320 240 700  330.5 230 -1e2\n"  # two joints


def read(tmp_path: Path, text: str | bytes, fmt: Format = "xyz") -> np.ndarray:
    """The joints of a file with this text, two per frame."""
    (tmp_path / "joints.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    return published.read_joints(tmp_path / "joints.txt", 2, fmt, NYU)


def test_read_joints(tmp_path: Path) -> None:
    """x y z are read unchanged; u v d are unprojected by the camera, where v grows downwards."""
    assert_array_equal(read(tmp_path, LINE), [[[320, 240, 700], [330.5, 230, -100]]])
    found = read(tmp_path, "320 240 700 378.803 181.293 500\n", "uvd")
    assert_allclose(found, [[[0, 0, 700], [50, 50, 500]]])
    assert found.dtype == np.float64


@pytest.mark.parametrize(
    "text",
    [
        LINE * 3,
        LINE * 3 + "\n \n",
        (LINE * 3).strip(),
        LINE.replace("\n", "\r\n") * 3,
        "\ufeff" + LINE * 3,
        LINE.replace(" ", "\t") * 3,
    ],
)
def test_line_ends_and_whitespace_do_not_matter(tmp_path: Path, text: str) -> None:
    """Trailing empty lines, a missing line end, CRLF, a byte order mark and tabs give the
    same three frames.
    """
    assert_array_equal(read(tmp_path, text), read(tmp_path, LINE * 3))


NUMBER, SIX = "expected a number of px or mm, below 1e+06", "expected 6 = 2 joints x 3"
METRES = "320 240 0.7  330.5 230 0.65\n300 200 0.71  310 200 0.7\n"


@bad_inputs(
    DataError,
    {
        f"{text!r} as {fmt}": ((text, fmt), f"...joints.txt{line}")
        for text, fmt, line in (
            ("", "xyz", ": empty, expected the numbers of a frame on each line"),
            (" \n\n", "xyz", ": empty, expected the numbers of a frame on each line"),
            (
                b"\x89HDF\r\n\x1a\n",
                "xyz",
                ": cannot read the joints: not a text file (byte 0 is not UTF-8)",
            ),
            (None, "xyz", ": cannot read the joints: No such file or directory"),
            (b"\0\0", "xyz", rf":1:1: found '\x00\x00', {NUMBER}"),
            (LINE + "1 2 3 4 5\n", "xyz", f":2: found 5 numbers, {SIX}"),
            ("1\n" + LINE, "xyz", f":1: found 1 number, {SIX}"),
            (LINE + "\n" + LINE, "xyz", f":2: found 0 numbers, {SIX}"),
            (LINE + "1 2  x3 4 5 6\n", "xyz", f":2:6: found 'x3', {NUMBER}"),
            ("# u v d\n" + LINE, "xyz", f":1:1: found '#', {NUMBER}"),
            ("1,2,3,4,5,6\n", "xyz", f":1:1: found '1,2,3,4,5,6', {NUMBER}"),
            (LINE + "1 2 3 4 nan 6\n", "xyz", f":2:9: found 'nan', {NUMBER}"),
            (LINE + "1 2 3 4 5 -inf\n", "xyz", f":2:11: found '-inf', {NUMBER}"),
            (LINE + "1e300 2 3 4 5 6\n", "xyz", f":2:1: found '1e300', {NUMBER}"),
            *(
                (
                    METRES,
                    fmt,
                    ": half of all depths are below 0.7; expected mm, more than 100: are they metres?",
                )
                for fmt in ("uvd", "xyz")
            ),
        )
    },
)
def test_mistakes(tmp_path: Path, given: tuple[str | bytes | None, Format], rejected: Any) -> None:
    text, fmt = given
    with rejected:
        if text is None:
            published.read_joints(tmp_path / "joints.txt", 2, fmt, NYU)
        read(tmp_path, text, fmt)


def test_pixels_without_depth(tmp_path: Path) -> None:
    """A pixel at depth 0 raises an error; x y z may have any depth."""
    text = "1 1 500 1 1 500\n1 1 500 1 1 0\n1 1 -3 1 1 500\n"
    with pytest.raises(
        DataError, match=r"txt:2: found a joint at depth 0, expected more than 0 mm \(2 of 3 frames"
    ):
        read(tmp_path, text, "uvd")
    assert len(read(tmp_path, text, "xyz")) == 3


def test_benchmarks() -> None:
    nyu, icvl = published.BENCHMARKS["nyu"], published.BENCHMARKS["icvl"]
    assert len(nyu.joints) == 14 and len(icvl.joints) == 16
    assert nyu.joints[:2] == ("little_tip", "little_pip_a")
    assert nyu.joints[8:] == (
        *("thumb_tip", "thumb_dip", "thumb_pip"),
        *("wrist_left", "wrist_middle", "palm"),
    )
    assert (nyu.camera, icvl.camera) == (NYU, ICVL) and (nyu.frames, icvl.frames) == (8252, 1596)
    assert (nyu.parts, icvl.parts) == (
        {"subject 1": slice(2440), "subject 2": slice(2440, None)},
        {},
    )


def test_score() -> None:
    """The figures of three frames with two joints equal those worked out by hand; an incomplete
    set has no parts.
    """
    benchmark = published.Benchmark(
        "two joints", ICVL, ("a", "b"), 3, {"first": slice(1), "others": slice(1, None)}
    )
    errors = np.array([[3.0, 5.0], [10.0, 0.0], [20.0, 40.0]])
    found = published.score_on(benchmark, errors)
    assert found.mean_mm == 13 and found.median_max_mm == 10
    assert found.parts_mm == {"first": 4, "others": 17.5} and found.joints_mm == {"a": 11, "b": 15}
    assert len(found.success_max) == len(found.success_mean) == 81
    assert [found.success_max[t] for t in (4, 5, 10, 40)] == [0, 1 / 3, 2 / 3, 1]
    assert [found.success_mean[t] for t in (3, 4, 30)] == [0, 1 / 3, 1]
    assert published.score_on(benchmark, errors[:2]).parts_mm == {}


def published_score(dataset: str, name: str) -> Score:
    """The score of a published file of predictions; the test is skipped where the
    file is missing.
    """
    folder = SHARED / dataset
    if not folder.is_dir():
        pytest.skip("needs published predictions")
    benchmark = published.BENCHMARKS[dataset]
    truth, predicted = (
        published.read_joints(folder / file, len(benchmark.joints), "uvd", benchmark.camera)
        for file in ("test_groundtruth_uvd.txt", f"predictions/{name}.txt")
    )
    return published.score_on(benchmark, joint_errors(predicted, truth))


@pytest.mark.parametrize(
    ("dataset", "name", "mean"),
    [
        ("nyu", "IJCAI16_NYU_DeepModel", 17.0359),
        ("nyu", "CVWW15_NYU_Prior", 20.7499),
        ("nyu", "ICCV15_NYU_Feedback", 15.9727),
        ("icvl", "IJCAI16_ICVL_DeepModel", 11.5611),
        ("icvl", "CVPR14_LRF_Results", 12.5776),
    ],
)
def test_published_results(dataset: str, name: str, mean: float) -> None:
    found = published_score(dataset, name)
    assert found.mean_mm == pytest.approx(mean, abs=1e-4)
    assert np.mean(list(found.joints_mm.values())) == pytest.approx(found.mean_mm)
    assert list(found.parts_mm) == (["subject 1", "subject 2"] if dataset == "nyu" else [])


def test_published_curve() -> None:
    """The curve equals the paper's on NYU, as do the errors on the two subjects."""
    found = published_score("nyu", "IJCAI16_NYU_DeepModel")
    assert found.parts_mm == pytest.approx({"subject 1": 10.154, "subject 2": 19.925}, abs=1e-3)
    rates = [found.success_max[t] for t in range(10, 81, 10)]
    assert_allclose(rates, [0.019, 0.190, 0.419, 0.582, 0.718, 0.834, 0.911, 0.951], atol=5e-4)


SKELETON = skeletons.load()


def test_angles_of_methods(rng: np.random.Generator) -> None:
    """A method without errors, one with a finger beyond its limits, and noise, which is
    not on the model.

    Angles beyond the limits are counted for joints on the model; progress covers every
    frame of each fit.
    """
    inputs = (
        BodySampler(prior_file.load().but(scale_std=0, bone_std=0))
        .draw(np.random.default_rng(2), 2)
        .inputs
    )
    bent = inputs.copy()
    dof = SKELETON.dof_names.index("index_base_rot_z")
    bent[1, dof] = SKELETON.upper[dof] + 0.3
    joints = (kinematics_of(SKELETON).joints(x)[:, EVALUATION_JOINTS] for x in (inputs, bent))
    truth, beyond = (xyz * 150 + (0, 0, 700) for xyz in joints)
    noise = truth + rng.normal(0, 5, truth.shape)
    watched: list[tuple[str, int, int]] = []

    @contextlib.contextmanager
    def watch(total: int, *, what: str) -> Iterator[Callable[[int], None]]:
        done: list[int] = []
        yield done.append
        watched.append((what, total, sum(done)))

    found = compare_angles(
        SKELETON, truth, {"same": truth, "beyond": beyond, "noise": noise}, watch
    )
    fits = (
        "annotation",
        "same",
        "same, no limits",
        "same, exactly",
        "beyond",
        "beyond, no limits",
        "beyond, exactly",
        "noise",
        "noise, no limits",
    )
    assert watched == [(what, 2, 2) for what in fits]
    assert found["same"].residual_mm < 0.1 and found["same"].free_residual_mm < 0.01
    assert [one.out_of_limits for one in found.values()] == [0, 0.5, None]
    assert found["same"].error_deg < 8, (
        "the ridge moves only angles that 14 joints hardly determine"
    )
    assert found["beyond"].free_residual_mm < 0.01 < 0.1 < found["beyond"].residual_mm
    # mm; noise of 5 mm per axis
    assert found["noise"].free_residual_mm < found["noise"].residual_mm < 8
    assert 0 < found["beyond"].error_deg < found["noise"].error_deg < 60
