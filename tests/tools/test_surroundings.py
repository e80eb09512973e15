"""Commands in unusual environments: in the C locale, without a home, with names that
are not UTF-8.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.support.running import run_python, run_tool
from tests.tools.conftest import ROOT

LOG = "Iteration 0, loss = 2\nIteration 5, loss = 1\n"
C_LOCALE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
ODD = os.fsdecode(b"odd\xe9")  # not valid in UTF-8


@pytest.fixture
def odd(here: Path) -> str:
    """A name that is not UTF-8, for the working directory."""
    try:
        Path(ODD).mkdir()
    except OSError:
        pytest.skip("this file system has no such names")
    Path(ODD).rmdir()
    return ODD


class TestNamesThatAreNotUtf8:
    def test_demo_and_predict(self, odd: str) -> None:
        assert r"--out 'odd\udce9'" in run_tool("demo --frames 1 --out", odd).out
        run_tool("predict", f"{odd}/frame_0.png", "--camera", "nyu", "--out", f"{odd}/again")
        assert len(list(Path(odd, "again").iterdir())) == 1

    @pytest.mark.parametrize("ending", ["", ".npz"])
    def test_recordings(self, odd: str, ending: str) -> None:
        command = "make_recording rest --camera icvl --seconds 0.1 --clean --out"
        run_tool(command, f"{odd}{ending}")
        assert {path.name for path in Path().iterdir()} == {f"{odd}{ending}", f"{odd}.truth.json"}

    @pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
    def test_plots(self, odd: str, ending: str) -> None:
        Path(f"{odd}.log").write_text(LOG)
        run_tool("plot_log", f"{odd}.log", "--out", f"{odd}.{ending}")
        assert Path(f"{odd}.{ending}").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no C locale")
def test_the_c_locale_without_a_home(tmp_path: Path) -> None:
    """In the C locale a file gets its exact name, which is printed escaped; Matplotlib prints
    nothing on stderr.
    """
    (tmp_path / "home").touch()
    (tmp_path / "ö.log").write_text(LOG)
    changes = {
        name: str(tmp_path / "home")
        for name in ("HOME", "USERPROFILE", "MPLCONFIGDIR", "XDG_CACHE_HOME")
    }
    done = run_python(
        ROOT / "tools" / "plot_log.py",
        "ö.log",
        "--out",
        "ü.png",
        cwd=tmp_path,
        **C_LOCALE,
        **changes,
    )
    assert done == (0, "wrote \\udcc3\\udcbc.png\n", "")
    assert (tmp_path / "ü.png").exists()
