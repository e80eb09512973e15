"""A training that is killed before any of its renames: the newest complete snapshot
resumes bit for bit.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.netlib.conftest import furnish
from tests.support.running import run_python

KILLS = """
import os, sys
from pathlib import Path
import numpy as np
import netlib

FORMAT, SUFFIX, overwrites = sys.argv[1], sys.argv[2], sys.argv[3] == "overwrites"


def trained(folder, seed, resume=None):
    os.makedirs(folder, exist_ok=True)
    solver = netlib.get_solver("solver.prototxt", seed=seed, engine="plain", snapshot=4, max_iter=8,
                               snapshot_prefix=f"{folder}/run", snapshot_format=FORMAT)
    assert solver.solve(resume)
    return np.concatenate([p.blob.data.ravel() for p in solver.net.learnable])


def killed(folder, seed, count):
    '''Train in a process that ends without any clean-up before its rename number ``count``.'''
    if (child := os.fork()) == 0:
        rename, calls = os.replace, []

        def counted(*args):
            calls.append(args)
            if len(calls) > count:
                os._exit(9)
            rename(*args)

        os.replace = counted
        trained(folder, seed)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


wanted = {seed: trained(f"whole_{seed}", seed) for seed in (1, 2)}
refused = resumed = 0
for count in range(5):
    folder = f"killed_{count}"
    if overwrites:
        trained(folder, 2)
    assert killed(folder, 1, count) == (9 if count < 4 else 0)
    names = [f"{folder}/run_iter_{i}" for i in (4, 8) if Path(f"{folder}/run_iter_{i}.caffemodel{SUFFIX}").exists()]
    for name in names:
        state = f"{name}.solverstate{SUFFIX}"
        try:
            found = trained(folder + "_resumed", 3, state)
            resumed += 1
            assert any(np.array_equal(found, values) for values in wanted.values()), state
        except netlib.WeightsError as error:
            refused += 1
            assert name == f"{folder}/run_iter_{4 * (count // 2 + 1)}" and count % 2 == 1, error
            others = [other for other in names if other != name]
            assert "\\n" not in str(error)
            advice = f"; the newest complete snapshot is {others[-1]}.solverstate{SUFFIX}" if others else ""
            assert str(error).endswith(advice)
    trained(folder, 1)
    assert sorted(os.listdir(folder)) == sorted(f"run_iter_{i}.{kind}{SUFFIX}" for i in (4, 8)
                                                for kind in ("caffemodel", "solverstate"))
print(resumed, refused)
"""


@pytest.mark.parametrize(
    ("format_", "suffix", "folder", "counts"),
    [("HDF5", ".h5", "is empty", "4 2"), ("BINARYPROTO", "", "overwrites", "8 2")],
)
def test_a_kill_before_each_rename(
    tmp_path: Path, format_: str, suffix: str, folder: str, counts: str
) -> None:
    furnish(tmp_path)
    assert run_python("-c", KILLS, format_, suffix, folder, cwd=tmp_path).out == f"{counts}\n"
