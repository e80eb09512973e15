"""tools/prepare_icvl.py, and a net trained on its output."""

from __future__ import annotations

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from handpose.datasets import icvl_files
from handpose.frames.cameras import ICVL
from handpose.frames.crops import crop
from tests.support.running import Done, run_tool
from tests.tools.conftest import ROOT

FRAMES = {"Training/labels.txt": 20, "Testing/test_seq_1.txt": 5, "Testing/test_seq_2.txt": 7}


@pytest.fixture
def root(tmp_path) -> Path:
    return write_icvl(tmp_path / "icvl")


def write_icvl(root: Path) -> Path:
    """Write a small data set in ICVL's layout, with a slanted plate in place of the hand."""
    rng = np.random.default_rng(0)
    for name, count in FRAMES.items():
        labels = root / name
        (labels.parent / "Depth" / labels.stem).mkdir(parents=True)
        lines = []
        for i in range(count):
            palm = np.array([rng.uniform(100, 220), rng.uniform(80, 160), rng.uniform(250, 450)])
            uvd = palm + rng.normal(0, 8, (16, 3))
            uvd[0] = palm
            image = np.full((240, 320), 32001, np.uint16)
            left, top, d = palm.astype(int) - (20, 20, 0)
            image[top : top + 40, left : left + 40] = d + np.arange(40)
            path = f"{labels.stem}/image_{i:04d}.png"
            assert cv2.imwrite(str(labels.parent / "Depth" / path), image)
            lines.append(f"{path} {' '.join(f'{value:.3f}' for value in uvd.ravel())} \n")
        labels.write_text("".join(lines) + "\n")
    return root


def prepare(root: Path) -> Done:
    return run_tool(f"prepare_icvl {root} --out {root.parent}/out")


def test_frames(root):
    """Crops are centred on the palm in a 250 mm cube, with 16 joints in half-cubes; test sequences
    are concatenated.
    """
    out = prepare(root).out
    labels = icvl_files.read_annotation([root / name for name in icvl_files.LABEL_FILES["test"]])
    with h5py.File(root.parent / "out" / "test_000.h5") as file:
        assert file.attrs["made_from"] == "ICVL"
        assert file["joint"].shape == (12, 48)
        assert file["depth"].shape == (12, 1, 128, 128)
        assert_array_equal(file["index"], np.arange(12))
        assert_array_equal(file["half_cube"], 125)
        assert_allclose(file["center_uvd"], labels.uvd[:, 0], rtol=1e-6)
        xyz = ICVL.unproject(labels.uvd)
        expected = np.clip((xyz - xyz[:, :1]) / 125, -1, 1)
        assert_allclose(file["joint"][:].reshape(-1, 16, 3), expected, atol=1e-6)
        assert_array_equal(file["joint"][:, :3], 0)  # the palm is the centre
        depth = cv2.imread(str(labels.files[7]), cv2.IMREAD_UNCHANGED)
        assert_array_equal(file["depth"][7, 0], crop(depth, labels.uvd[7, 0], 250, ICVL))
    assert "test: 12 frames (ICVL), none bad" in out
    assert "annotated palm, cube 250 mm" in out


def test_net_learns_from_them(root):
    prepare(root)
    here, prototxt = root.parent, ROOT / "prototxt"
    for name, changes in (
        (
            "icvl_train_test",
            {
                "data/icvl": f"{here}/out",
                "batch_size: 512": "batch_size: 20",
                "batch_size: 228": "batch_size: 12",
                '"hand/icvl': f'"{prototxt}/hand/icvl',
            },
        ),
        (
            "icvl_solver",
            {
                "test_iter: 7": "test_iter: 1",
                "prototxt/icvl_train_test": f"{here}/icvl_train_test",
                "snapshots/icvl": f"{here}/snapshot",
            },
        ),
    ):
        text = (prototxt / f"{name}.prototxt").read_text()
        for old, new in changes.items():
            text = text.replace(old, new)
        (here / f"{name}.prototxt").write_text(text)
    solver = netlib.get_solver(here / "icvl_solver.prototxt")
    assert solver.net.blobs["pred"].shape == (20, 48)
    assert solver.net.blobs["hand"].shape == (20, 63)
    solver.step(1)
    first = float(solver.net.blobs["joint_loss"].data)
    solver.step(10)
    assert float(solver.net.blobs["joint_loss"].data) < 0.9 * first
    assert solver.test_nets[0].forward()["joint_loss"].shape == ()
