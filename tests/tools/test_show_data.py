"""tools/show_data.py: images of data sets."""

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from tests.support.hdf5_files import write_hdf5
from tests.support.running import run_tool


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """A list of one HDF5 file with five frames."""
    write_hdf5(
        tmp_path / "a.h5",
        depth=np.random.default_rng(0).uniform(-1, 1, (5, 1, 128, 128)).astype(np.float32),
        joint=np.random.default_rng(0).uniform(-0.5, 0.5, (5, 93)).astype(np.float32),
    )
    (tmp_path / "list.txt").write_text(f"{tmp_path / 'a.h5'}\n")
    return tmp_path / "list.txt"


def test_lists_files_and_folders_side_by_side(frames: Path, tmp_path: Path) -> None:
    """Each of three sets starts a new row; a list and a file show the same frames."""
    crops = tmp_path / "crops"
    crops.mkdir()
    cv2.imwrite(str(crops / "one.png"), np.full((128, 128), 127, np.uint8))
    out = tmp_path / "out.png"
    argv = [str(frames), str(tmp_path / "a.h5"), str(crops), "--out", str(out), "--frames", "4", "--columns", "4"]
    run_tool("show_data", *argv)
    picture = cv2.imread(str(out))
    head, gap, size = 22, 4, 128
    rows = [picture[r * (size + head + gap) + gap + head :][:size] for r in range(3)]
    assert np.array_equal(rows[0], rows[1])
    assert np.ptp(rows[2][:, gap + 2 * (size + gap) :]) == 0  # only white next to the single crop


def test_plain_draws_no_hands(frames: Path, tmp_path: Path) -> None:
    """Colour occurs only where a skeleton is drawn."""
    for plain in (True, False):
        out = tmp_path / "out.png"
        run_tool("show_data", frames, "--out", out, *(["--plain"] if plain else []))
        picture = cv2.imread(str(out)).astype(int)
        assert (np.ptp(picture, axis=2).max() == 0) == plain


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda folder: folder / "missing.txt", "missing.txt"),
        (lambda folder: folder / "missing.h5", "cannot read the HDF5 file"),
        (lambda folder: folder, "no PNG pictures in this folder"),
    ],
)
def test_mistakes(tmp_path: Path, make: object, message: str) -> None:
    """Errors are one line each."""
    error = run_tool("show_data", make(tmp_path), "--out", tmp_path / "out.png", status=1).err
    assert message in error and error.count("\n") == 1 and not (tmp_path / "out.png").exists()


def test_a_file_without_crops(tmp_path: Path) -> None:
    """A data set without crops is reported with its shape."""
    write_hdf5(tmp_path / "a.h5", depth=np.zeros((3, 4)))
    done = run_tool("show_data", tmp_path / "a.h5", "--out", tmp_path / "out.png", status=1)
    assert "data set 'depth' has shape (3, 4), expected square crops" in done.err


@pytest.mark.parametrize("name", ["out.png", "out.jpg"])
@pytest.mark.parametrize("zoom", ["200", "100000", str(2**63 - 1)])
def test_more_than_a_picture_can_be(frames: Path, tmp_path: Path, zoom: str, name: str) -> None:
    """An image that is too large gives a one-line error."""
    error = run_tool("show_data", frames, "--out", tmp_path / name, "--zoom", zoom, status=1).err
    assert error.startswith(f"{5 * 128 * int(zoom)} x {128 * int(zoom)} pixels; expected at most")
    assert error.count("\n") == 1 and not (tmp_path / name).exists()


def test_more_columns_than_frames(frames: Path, tmp_path: Path) -> None:
    """Columns beyond the number of frames are not drawn."""
    for columns in ("5", "100000"):
        run_tool("show_data", frames, "--out", tmp_path / f"{columns}.png", "--columns", columns)
    assert (tmp_path / "5.png").read_bytes() == (tmp_path / "100000.png").read_bytes()


def test_the_skeleton_of_another_body(frames: Path, tmp_path: Path) -> None:
    """A skeleton of another body is an error."""
    (tmp_path / "one.prototxt").write_text('joint { name: "only" }')
    options = ["--skeleton", str(tmp_path / "one.prototxt"), "--out", str(tmp_path / "out.png")]
    error = run_tool("show_data", frames, *options, status=1).err
    assert "frames have 31 joints" in error and "one.prototxt has 1" in error and not (tmp_path / "out.png").exists()


@pytest.mark.parametrize("name", [".png", "a.gif"])
def test_pictures_of_no_name_or_another_kind(frames: Path, tmp_path: Path, name: str) -> None:
    """A missing name or an unsupported suffix is a usage error."""
    run_tool("show_data", frames, "--out", tmp_path / name, status=2)


def test_joints_that_are_not_finite(frames: Path, tmp_path: Path) -> None:
    """The error names the file, not only the list; --plain shows the crops."""
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["joint"][4, 1] = np.nan
    argv = [str(frames), "--out", str(tmp_path / "out.png")]
    done = run_tool("show_data", *argv, status=1)
    expected = f"{tmp_path}/a.h5: frame 4: its joints are not finite; use --plain to omit hands\n"
    assert done.err == expected
    run_tool("show_data", *argv, "--plain")
