"""Delete the folder fast/, and all else works: it imports, trains, and passes its tests on the plain engine."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import UNDER_BOTH

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = ("fast", "test_without_fast.py", ".*", "__pycache__", "data", "snapshots", "build", "site", "*.egg-info")

# An installed copy of this project must not lend its own fast/ to the copy without it.
NO_OTHER_COPY = f"""
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if not finder.__module__.startswith("__editable__")]
sys.path[:] = [folder for folder in sys.path if folder != {str(ROOT)!r}]
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project without fast/ and its tests."""
    copy = tmp_path_factory.mktemp("bare") / "project"

    def ignored(folder: str, names: list[str]) -> set[str]:
        top = Path(folder) == ROOT
        kept = {"data", "site"} if not top else set()  # layers/data, handpose/data, docs/making/site
        return set(shutil.ignore_patterns(*(p for p in LEFT_OUT if p not in kept))(folder, names))

    shutil.copytree(ROOT, copy, ignore=ignored)
    (copy / "sitecustomize.py").write_text(NO_OTHER_COPY)
    return copy


def run(folder: Path, *argv: str) -> subprocess.CompletedProcess[str]:
    """A fresh Python in the copy."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("NETLIB", "PYTEST"))}
    environment["PYTHONPATH"] = str(folder)
    return subprocess.run([sys.executable, *argv], cwd=folder, env=environment, capture_output=True, text=True)


def test_fast_is_gone(bare: Path) -> None:
    """Else the other tests would say nothing."""
    done = run(bare, "-c", "import netlib; from netlib import engine; print(netlib.__file__, engine.has_fast())")
    assert done.stdout == f"{bare}/netlib/__init__.py False\n", done.stderr


def test_a_solver_trains(bare: Path) -> None:
    """By the command line, with the plain engine because there is no other."""
    made = run(bare, "tools/make_synthetic.py", "--out", "data/nyu", "--train", "64", "--test", "64", "--workers", "1")
    assert made.returncode == 0, made.stderr
    net = bare / "prototxt" / "nyu_train_test.prototxt"
    whole = net.read_text()
    net.write_text(whole.replace("batch_size: 512", "batch_size: 8").replace("batch_size: 250", "batch_size: 8"))
    done = run(bare, "tools/train.py", "prototxt/nyu_solver.prototxt", "--max-iter", "2")
    net.write_text(whole)  # other tests take it as it is
    assert done.returncode == 0, done.stderr
    assert "1 thread, engine plain. BLAS: as NumPy sets it up" in done.stderr
    assert (bare / "snapshots" / "nyu_iter_2.caffemodel.h5").is_file()
    shutil.rmtree(bare / "data")


# What knows no engine (files of recordings and tracks, data sets, rendered hands, published predictions, pictures,
# documents, benchmarks, how a command begins, what several processes tell each other, what the campaign damages);
# exercises, whose nets are always plain; and finding, tracking, measuring and Table 1, which are made of fits and
# trainings that are tested: they take minutes on that engine. What runs under both engines where there are two is left
# out as well.
ELSEWHERE = ("faults", "docs", "documents", "benchmarks", "test_arrows.py", "test_data_is_no_code.py", "test_linear.py",
             *(f"handpose/{room}" for room in ("data", "drawing", "experiments", "facts", "flesh", "predicting",
               "recordings", "scoring", "synthetic", "test_rooms.py", "tracking", "tracks")),
             *(f"tools/test_{name}.py" for name in ("begin", "calibrate_hand", "evaluate", "make_recording",
               "make_synthetic", "measure_finding", "measure_tracking", "package_model", "prepare_icvl", "prepare_nyu",
               "record", "table1", "track", "track_refusals", "train_ranks")), "tools/exercises")  # fmt: skip
HANDS = ("handpose", "tools")  # about half of the time


@pytest.mark.parametrize("half", ["hands", "nets"])
def test_all_other_tests_pass(bare: Path, half: str) -> None:
    """On the plain engine alone. In two halves, for two processors."""
    left_out = [*ELSEWHERE, *(HANDS if half == "nets" else ())]
    ignored = [word for name in left_out for word in ("--ignore", f"tests/{name}")]
    for name in UNDER_BOTH:
        ignored += ["--ignore-glob", f"*/{name}.py"] if name.startswith("test_") else ["--ignore", f"tests/{name}"]
    folders = [f"tests/{name}" for name in HANDS] if half == "hands" else ["tests"]
    done = run(bare, "-m", "pytest", "-q", "-p", "no:cacheprovider", *folders, *ignored)
    summary = done.stdout.splitlines()[-1]
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert int(re.search(r"(\d+) passed", summary)[1]) > 300, summary  # type: ignore[index]
