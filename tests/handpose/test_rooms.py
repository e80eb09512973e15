"""The rooms of handpose: who may import whom, and what it costs to ask for a fact."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from source_imports import imports, offenders

ROOT = Path(__file__).resolve().parents[2]
MAY_IMPORT = {  # besides itself
    "facts": set(),
    "data": {"facts"},
    "recordings": {"facts", "data"},
    "flesh": {"facts", "data"},
    "joint_formats": {"facts", "flesh"},
    "tracks": {"facts", "data", "flesh", "joint_formats"},
    "synthetic": {"facts", "data", "flesh", "recordings", "tracks"},
    "fitting": {"facts", "data", "flesh"},
    "predicting": {"facts", "data", "flesh", "fitting"},
    "tracking": {"facts", "data", "flesh", "fitting", "predicting", "recordings", "tracks"},
    "drawing": {"facts", "data", "flesh", "tracks"},
    "scoring": {"facts", "data", "fitting", "predicting", "tracks"},
    "experiments": {"facts", "data", "fitting", "scoring", "synthetic", "predicting", "tracking", "tracks"},
}
# A file that needs an extra, and which: it imports it when it is used.
EXTRAS: dict[str, set[str]] = {
    "drawing/rerun_view.py": {"rerun"},
    "drawing/video_file.py": {"av"},
    "recordings/ffmpeg.py": {"av"},
    "recordings/ros_bag.py": {"rosbags"},
    "recordings/ros_limits.py": {"apsw", "lz4", "rosbags"},
    "recordings/realsense.py": {"pyrealsense2"},
}
SHARED = "rounding.py"  # beside the rooms, for all of them; it imports none
FILES = sorted((ROOT / "handpose").rglob("*.py"))


def test_every_file_is_in_a_room() -> None:
    """And no package imports anything for others."""
    assert {path.relative_to(ROOT / "handpose").parts[0] for path in FILES} == {*MAY_IMPORT, "__init__.py", SHARED}
    assert all(not imports(path) for path in FILES if path.name == "__init__.py")


def test_arrows() -> None:
    """Facts below data, data below what computes with them; nobody imports tools, or fast by name."""
    wrong = {}
    for path in FILES:
        name, room = path.relative_to(ROOT / "handpose").as_posix(), path.relative_to(ROOT / "handpose").parts[0]
        found = imports(path)
        others = {name.split(".")[1] for name in found if name.startswith("handpose.")} - {room, Path(SHARED).stem}
        outside = {name.split(".")[0] for name in found} - set(sys.stdlib_module_names) - {"handpose"}
        core = {"numpy"} if room == "facts" else {"numpy", "scipy", "cv2", "h5py", "netlib", "layers"}
        wrong[name] = (others - MAY_IMPORT.get(room, set())) | (outside - core - EXTRAS.get(name, set()))
    assert offenders(wrong) == {}


@pytest.mark.parametrize(
    ("module", "never"),
    [
        ("handpose.facts.nyu", ["scipy", "cv2", "h5py", "netlib"]),
        ("handpose.facts.cameras", ["scipy", "cv2", "h5py", "netlib"]),
        ("handpose.scoring.metrics", ["scipy.io", "cv2", "handpose.data", "handpose.synthetic", "multiprocessing"]),
        ("handpose.predicting.predictor", ["scipy.io", "handpose.synthetic", "multiprocessing"]),
    ],
)
def test_what_is_loaded(module: str, never: list[str]) -> None:
    """A fact, a figure or a prediction loads no importer, no renderer and no pool of processes."""
    code = f"import sys, {module}; print(sorted(set({never}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "[]"
