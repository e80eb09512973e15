"""Without the folder fast/, everything else works: the project imports, trains, and
passes its tests.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import pytest

from tests.support.running import ROOT, Done, run_python

LEFT_OUT = (
    "fast",
    "test_without_fast.py",
    ".*",
    "data",
    "snapshots",
    "build",
    "site",
    "*.egg-info",
)

# An installed copy of this project must not lend its own fast/ to the copy without it.
NO_OTHER_COPY = f"""
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if not finder.__module__.startswith("__editable__")]
sys.path[:] = [folder for folder in sys.path if folder != {str(ROOT)!r}]
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project without fast/ and its tests.

    Compiled files are copied as well to save time.
    """
    copy = tmp_path_factory.mktemp("bare") / "project"

    def ignored(folder: str, names: list[str]) -> set[str]:
        top = Path(folder) == ROOT
        kept = {"data", "snapshots"} if not top else set()  # layers/data, netlib/snapshots
        return set(shutil.ignore_patterns(*(p for p in LEFT_OUT if p not in kept))(folder, names))

    shutil.copytree(ROOT, copy, ignore=ignored)
    (copy / "sitecustomize.py").write_text(NO_OTHER_COPY)
    return copy


def run(folder: Path, *argv: str) -> Done:
    """Run a fresh Python in the copy."""
    unset = dict.fromkeys(name for name in os.environ if name.startswith(("NETLIB", "PYTEST")))
    return run_python(*argv, cwd=folder, **unset, PYTHONPATH=str(folder))


def test_fast_is_gone(bare: Path) -> None:
    """The copy has no fast engine, which the other tests here assume."""
    done = run(
        bare,
        "-c",
        "import netlib; from netlib import engine; print(netlib.__file__, engine.has_fast())",
    )
    assert done.out == f"{bare}/netlib/__init__.py False\n"


def test_a_solver_trains(bare: Path) -> None:
    """A solver trains from the command line with the plain engine, the only one there."""
    run(
        bare,
        "tools/make_synthetic.py",
        "--out",
        "data/nyu",
        "--train",
        "64",
        "--test",
        "64",
        "--workers",
        "1",
    )
    net = bare / "prototxt" / "nyu_train_test.prototxt"
    whole = net.read_text()
    net.write_text(
        whole.replace("batch_size: 512", "batch_size: 8").replace(
            "batch_size: 250", "batch_size: 8"
        )
    )
    done = run(bare, "tools/train.py", "prototxt/nyu_solver.prototxt", "--max-iter", "2")
    net.write_text(whole)  # other tests need the original net
    assert "1 thread, engine plain. BLAS: as NumPy sets it up" in done.err
    assert (bare / "snapshots" / "nyu_iter_2.caffemodel.h5").is_file()
    shutil.rmtree(bare / "data")


# Tests that query or use the default engine. The others do not depend on it, or run on the
# plain engine in the whole suite as well; a contract of `make lint` ensures that nothing
# imports fast/ by name.
WHERE_IT_COUNTS = (
    "test_nets.py",
    "netlib/test_engine.py",
    "netlib/caffe/test_pycaffe.py",
    "tools/test_time.py",
    "tools/test_tools.py::test_help_is_the_docstring",
    "tools/test_predict.py::test_a_hand_with_the_packaged_weights",
)


def test_tests_of_nets_pass(bare: Path) -> None:
    """The tests of nets pass on the plain engine alone."""
    tests = [f"tests/{name}" for name in WHERE_IT_COUNTS]
    done = run(bare, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests)
    summary = done.out.splitlines()[-1]
    assert int(re.search(r"(\d+) passed", summary)[1]) > 80, summary  # type: ignore[index]
