"""How a tool detects the processes of a launcher, without MPI."""

import sys

import pytest

from netlib import engine
from netlib.distributed.ranks import ALONE, Ranks
from netlib.errors import NetlibError
from tools.common import ranks


@pytest.fixture(autouse=True)
def nobody_started_us(monkeypatch):
    """Remove the variables of all launchers and the module mpi4py."""
    for count, number in ranks.LAUNCHERS:
        monkeypatch.delenv(count, raising=False)
        monkeypatch.delenv(number, raising=False)
    monkeypatch.delitem(sys.modules, "mpi4py", raising=False)


def test_alone():
    """Without a launcher, with a single process, and in a Slurm shell, MPI is not loaded."""
    assert ranks.world() is ALONE
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PMI_SIZE", "1")
        patch.setenv("PMI_RANK", "0")
        patch.setenv("SLURM_STEP_NUM_TASKS", "4")
        patch.setenv("SLURM_PROCID", "0")
        assert ranks.world() is ALONE
        patch.delenv("PMI_SIZE")
        assert ranks.world() is ALONE
    assert "mpi4py" not in sys.modules


@pytest.mark.parametrize(("count", "number"), ranks.LAUNCHERS)
def test_without_mpi4py(monkeypatch, capsys, count, number):
    """Several processes require mpi4py; the first reports it, and the others exit silently
    with status 0.
    """
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    monkeypatch.setenv(count, "3")
    monkeypatch.setenv(number, "0")
    with (
        pytest.raises(
            NetlibError,
            match=r"^3 processes were started to train together, which needs mpi4py: .*pip install mpi4py mpich$",
        ),
        ranks.only_first_prints(),
    ):
        ranks.world()
    monkeypatch.setenv(number, "2")
    with pytest.raises(SystemExit) as ended, ranks.only_first_prints():
        print("a usage")
        ranks.world()
    assert ended.value.code == 0
    assert capsys.readouterr().out == ""


def test_threads(monkeypatch):
    """The ranks of a machine share its processors; without ranks the number of
    threads is not set.
    """

    class OneOfThree(Ranks):
        count, on_machine = 3, 3

    assert ranks.threads_of(ALONE) is None
    for processors, threads in ((8, 2), (2, 1)):
        monkeypatch.setattr(engine, "available_cpus", lambda processors=processors: processors)
        assert ranks.threads_of(OneOfThree()) == threads
