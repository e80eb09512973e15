"""experiments/table1/recipes.py: solvers with other fields"""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.table1.recipes import with_fields
from netlib.proto import prototxt

SOLVER = """net: "a.prototxt"
base_lr: 0.1  # of the first net

test_iter: 3 test_interval: 10
stepvalue: 5
stepvalue: 8
max_iter: 100
snapshot: 50
snapshot_prefix: "a"
"""


def test_own_fields_take_the_place_of_others() -> None:
    """Repeated fields are replaced as well; tests, snapshots and comments are removed."""
    own = {"lr_policy": '"fixed"', "stepvalue": 6, "max_iter": 7, "snapshot_format": "HDF5"}
    assert str(with_fields(prototxt.parse(SOLVER), own)) == (
        'net: "a.prototxt"\nbase_lr: 0.1\nlr_policy: "fixed"\nstepvalue: 6\nmax_iter: 7\nsnapshot_format: HDF5\n'
    )


@pytest.mark.parametrize("name", ["c.prototxt", 'my "c".prototxt', "a b/ü.prototxt"])
def test_a_path_is_a_string(name: str) -> None:
    """A path with special characters is unchanged when the solver is read again."""
    tree = prototxt.parse(str(with_fields(prototxt.parse(SOLVER), {"net": Path("b") / name})))
    (value,) = tree.values("net")
    assert value == prototxt.Scalar("string", f"b/{name}", tree.position)
