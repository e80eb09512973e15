"""PhysLimit."""

import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs

SKELETON = """
    dof { name: "bent" lower: -1 upper: 2 }
    dof { name: "free" }
    dof { name: "fixed" lower: -1 upper: 1 fixed: true }
    joint { name: "j" rotate { axis: Z dof: "bent" } rotate { axis: X dof: "free" } rotate { axis: Y dof: "fixed" } }
"""
# beyond by 2 and -0.5, within, exactly at the limit
X = [[4.0, 100, 9], [-1.5, -100, -9], [0, 0, 0], [2, 1, 5]]


@pytest.fixture
def text(tmp_path):
    """The layer with a skeleton that has one limited DoF."""
    (tmp_path / "s.prototxt").write_text(SKELETON)
    return f'type: "PhysLimit" phys_limit_param {{ skeleton: "{tmp_path}/s.prototxt" %s }}'


@pytest.mark.parametrize(
    ("norm", "loss", "gradient"),
    [
        ("", 2.5 / 4, [1, -1, 0, 0]),
        ("norm: L1", 2.5 / 4, [1, -1, 0, 0]),
        ("norm: L2", 4.25 / 4, [4, -1, 0, 0]),
    ],
)
def test_by_hand(run, text, norm, loss, gradient):
    """The loss is the mean over the items; fixed and unlimited DoFs add nothing and
    have gradient 0.
    """
    done = run(text % norm, X)
    assert done.y == loss
    [dx] = done.backward(2)
    assert dx[:, 0].tolist() == [2 * g / 4 for g in gradient]
    assert not dx[:, 1:].any()


@bad_inputs(
    netlib.LayerError,
    {
        "four inputs": (
            ("", (2, 4)),
            "<gradcheck>:1:1: error: layer 'it': bottom 'bottom0' has shape (2, 4), the skeleton has 3 DoFs",
        ),
        "a number": (
            ("", ()),
            "...: error: layer 'it': bottom 'bottom0' has shape (), the skeleton has 3 DoFs",
        ),
        "norm": (
            ("norm: L3", (2, 3)),
            netlib.PrototxtError,
            "<gradcheck>:1:...: error: unknown value L3 of 'norm'; known values: L1, L2",
        ),
    },
)
def test_mistakes(run, text, given, rejected):
    with rejected:
        run(text % given[0], np.zeros(given[1]))
