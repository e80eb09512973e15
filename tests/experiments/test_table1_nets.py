"""experiments/table1_nets.py"""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.table1_nets import (
    NETWORKS,
    PROTOTXT,
    RECIPES,
    derived_net,
    layers_of,
    set_limit,
    solvers,
)
from netlib.errors import NetlibError
from netlib.proto import messages, prototxt, schema
from netlib.proto.net_parameter import load_parameter
from netlib.training import solver_parameter
from netlib.updates import learning_rate

LISTS = {split: Path(f"/data/{split}.txt") for split in ("train", "test")}


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("network", NETWORKS)
def test_every_net_has_the_hidden_layers_of_ours(network: str, recipe: str) -> None:
    """A printed net parses to the same text and has the data and losses of its recipe; up to the
    last hidden layer it equals ours, character by character.
    """
    printed = str(derived_net(network, RECIPES[recipe], LISTS))
    param = load_parameter(prototxt.parse(printed))
    sources = [
        str(layer.blocks["hdf5_data_param"].values("source")[0]) for layer in param.layer[:2]
    ]
    assert sources == ['"/data/train.txt"', '"/data/test.txt"']
    assert str(prototxt.parse(printed)) == printed
    kinds = [layer.type for layer in param.layer]
    assert ("Dropout" in kinds, "SmoothL1Loss" in kinds) == (
        (False, True) if recipe == "adam" else (True, False)
    )
    own, ours = (
        text[text.index('name: "convL1"') : text.index('name: "ReLUFC2"')]
        for text in (printed, str(derived_net("ours", RECIPES[recipe], LISTS)))
    )
    assert own == ours


def test_the_papers_recipe_changes_only_the_data_layers() -> None:
    derived = derived_net("ours", RECIPES["paper"], LISTS)
    own = prototxt.parse_file(PROTOTXT / NETWORKS["ours"])
    changed = [
        (str(a), str(b)) for a, b in zip(layers_of(derived), layers_of(own)) if str(a) != str(b)
    ]
    assert len(changed) == 2 and all('"HDF5Data"' in a for a, _ in changed)
    assert "batch_size: 512" in changed[0][0]
    assert "batch_size: 256" in changed[1][0]
    assert "shuffle" in changed[0][0]


def test_our_recipes_net_is_that_for_synthetic_hands() -> None:
    """Only the data, the augmentation and the second head differ from the net for
    synthetic hands.
    """
    ours = PROTOTXT / "synthetic_train_test.prototxt"
    others = ("data", "augment", "direct", "direct_loss")
    wanted = [
        str(layer)
        for layer in layers_of(prototxt.parse_file(ours))
        if layer.text("name") not in others
    ]
    assert [str(layer) for layer in layers_of(derived_net("ours", RECIPES["adam"], LISTS))][
        2:
    ] == wanted


def test_the_weight_of_physlimit() -> None:
    net = derived_net("ours", RECIPES["paper"], LISTS)
    set_limit(net, 10.0, "L2")
    *_, limit = layers_of(net)
    assert (limit.text("type"), limit.text("loss_weight")) == ("PhysLimit", "10.0")
    assert "L2" in str(limit)
    with pytest.raises(NetlibError, match="no PhysLimit"):
        set_limit(derived_net("direct_joint", RECIPES["paper"], LISTS), 10.0, "L2")


def test_the_papers_solver() -> None:
    """The rate is the paper's for nine tenths of the iterations, then a tenth of it."""
    ((last, tree),) = solvers(
        RECIPES["paper"], 4000, {"net": Path('a "b".prototxt'), "random_seed": 3}
    )
    solver = schema.read(tree, messages.SolverParameter, "solver")
    paper = solver_parameter.read(RECIPES["paper"].solver)
    assert last == solver.max_iter == 4000
    assert solver.net == 'a "b".prototxt'
    assert solver.random_seed == 3
    assert (solver.momentum, solver.type, solver.test_iter, solver.snapshot) == (
        paper.momentum,
        paper.type,
        (),
        0,
    )
    assert learning_rate(solver, 3599) == paper.base_lr
    assert learning_rate(solver, 3600) == pytest.approx(paper.base_lr / 10)


def test_our_recipe_decays_the_rate_linearly() -> None:
    """The rate is constant after its rise, then falls linearly from there to 0."""
    (branch, first), (last, second) = solvers(RECIPES["adam"], 20000, {})
    trunk, end = (schema.read(tree, messages.SolverParameter, "solver") for tree in (first, second))
    assert (branch, trunk.max_iter, last, end.max_iter) == (14000, 14000, 20000, 20000)
    assert learning_rate(trunk, 500) == pytest.approx(0.001)
    assert learning_rate(trunk, 13999) == pytest.approx(0.002)
    assert [learning_rate(end, i) for i in (14000, 17000, 20000)] == pytest.approx(
        [0.002, 0.001, 0]
    )
