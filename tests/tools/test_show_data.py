"""tools/show_data.py: images of data sets."""

import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from tests.support.hdf5_files import write_hdf5
from tests.support.running import refusal, run_tool
from tests.tools.conftest import mistakes_of


@pytest.fixture
def frames(here: Path, rng: np.random.Generator) -> Path:
    """A list of one HDF5 file with five frames."""
    depth, joint = rng.uniform(-1, 1, (5, 1, 128, 128)), rng.uniform(-0.5, 0.5, (5, 93))
    write_hdf5(here / "a.h5", depth=np.float32(depth), joint=np.float32(joint))
    (here / "list.txt").write_text(f"{here / 'a.h5'}\n")
    return here / "list.txt"


def test_lists_files_and_folders_side_by_side(frames: Path) -> None:
    """Each of three sets starts a new row; a list and a file show the same frames."""
    Path("crops").mkdir()
    cv2.imwrite("crops/one.png", np.full((128, 128), 127, np.uint8))
    run_tool("show_data", frames, "a.h5", "crops", "--out", "out.png", "--frames", "4")
    picture = cv2.imread("out.png")
    head, gap, size = 22, 4, 128
    first, step = gap + head, gap + head + size
    rows = [picture[first + r * step :][:size] for r in range(3)]
    assert np.array_equal(rows[0], rows[1])
    assert np.ptp(rows[2][:, gap + 2 * (size + gap) :]) == 0  # only white next to the single crop


def test_plain_draws_no_hands(frames: Path) -> None:
    """Colour occurs only where a skeleton is drawn."""
    for plain in (True, False):
        run_tool("show_data", frames, "--out", "out.png", *(["--plain"] if plain else []))
        picture = cv2.imread("out.png").astype(int)
        assert (np.ptp(picture, axis=2).max() == 0) == plain


@mistakes_of("show_data")
def test_mistakes(frames: Path, argv: str, message: str) -> None:
    write_hdf5("flat.h5", depth=np.zeros((3, 4)))
    with h5py.File("a.h5") as file:
        joints = file["joint"][...]
        joints[4, 1] = np.nan
        write_hdf5("nan.h5", depth=file["depth"][...], joint=joints)
    Path("one.prototxt").write_text('joint { name: "only" }')
    Path("list.png").write_text("b.png\n")
    shutil.copy("a.h5", "b.png")
    for folder in ("crops", "whole"):
        Path(folder).mkdir()
    cv2.imwrite("whole/0.png", np.full((48, 64), 500, np.uint16))
    for n in range(3):
        cv2.imwrite(f"crops/{n}.png", np.full((128, 128), 127, np.uint8))
    assert message in refusal("show_data --out out.png", *argv.split())
    run_tool("show_data nan.h5 --out out.png --plain")
