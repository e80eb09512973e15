"""The packages of handpose: what they need from others, and what an import loads (setup.cfg has the order)."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.source_imports import imports, offenders

ROOT = Path(__file__).resolve().parents[2]
# A file that needs an extra, and which: it imports it when it is used.
EXTRAS: dict[str, set[str]] = {
    "drawing/rerun_view.py": {"rerun"},
    "drawing/video_file.py": {"av"},
    "sources/ffmpeg.py": {"av"},
    "sources/ros_bag.py": {"rosbags"},
    "sources/ros_limits.py": {"apsw", "lz4", "rosbags"},
    "sources/realsense.py": {"pyrealsense2"},
}
FILES = sorted((ROOT / "handpose").rglob("*.py"))


def test_other_packages() -> None:
    """Facts need NumPy, all others NumPy, SciPy, OpenCV and h5py, and an extra where it is used; none imports fast."""
    wrong = {}
    for path in FILES:
        name = path.relative_to(ROOT / "handpose").as_posix()
        outside = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names) - {"handpose"}
        core = {"numpy"} if name.startswith("facts/") else {"numpy", "scipy", "cv2", "h5py", "netlib", "layers"}
        wrong[name] = outside - core - EXTRAS.get(name, set())
    assert offenders(wrong) == {}


@pytest.mark.parametrize(
    ("module", "never"),
    [
        ("handpose.facts.nyu", ["scipy", "cv2", "h5py", "netlib"]),
        ("handpose.facts.cameras", ["scipy", "cv2", "h5py", "netlib"]),
        ("handpose.scoring.metrics", ["scipy.io", "cv2", "handpose.data", "handpose.synthetic", "multiprocessing"]),
        ("handpose.prediction.predictor", ["scipy.io", "handpose.synthetic", "multiprocessing"]),
    ],
)
def test_what_is_loaded(module: str, never: list[str]) -> None:
    """A fact, a figure or a prediction loads no importer, no renderer and no pool of processes."""
    code = f"import sys, {module}; print(sorted(set({never}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"
