"""experiments/table1.py: derived nets, solvers and scores."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.table1 import (
    NETWORKS,
    PROTOTXT,
    RECIPES,
    angles_of,
    derived_net,
    layers_of,
    scores,
    set_limit,
    solvers,
    text_of,
    write_components,
)
from handpose.scoring.held_out import Predictions
from handpose.synthetic.generator import Generator
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import NetlibError
from netlib.proto import messages, prototxt, schema
from netlib.proto.net_parameter import load_parameter
from netlib.training import solver_parameter
from netlib.updates import learning_rate
from tests.support.hdf5_files import write_hdf5

LISTS = {split: Path(f"/data/{split}.txt") for split in ("train", "test")}


def features(model: Path) -> list[str]:
    """The layers from the depth to FC2, as text."""
    layers = [str(layer) for layer in layers_of(prototxt.parse_file(model))]
    names = [re.search('name: "(.*)"', layer)[1] for layer in layers]  # type: ignore[index]
    return layers[names.index("convL1") : names.index("DropoutFC2") + 1]


def test_the_networks_differ_after_the_features_only() -> None:
    """The layers up to the last hidden one equal the paper's, character by character."""
    one, *others = (features(PROTOTXT / file) for file in NETWORKS.values())
    assert len(one) == 14 and all(other == one for other in others)


@pytest.mark.parametrize("recipe", RECIPES)
@pytest.mark.parametrize("network", NETWORKS)
def test_every_net_is_one(network: str, recipe: str) -> None:
    """A printed net parses to the same text and has the data, layers and losses of its recipe."""
    printed = str(derived_net(network, RECIPES[recipe], LISTS))
    param = load_parameter(prototxt.parse(printed))
    sources = [str(layer.blocks["hdf5_data_param"].values("source")[0]) for layer in param.layer[:2]]
    assert sources == ['"/data/train.txt"', '"/data/test.txt"'] and str(prototxt.parse(printed)) == printed
    kinds = [layer.type for layer in param.layer]
    assert ("Dropout" in kinds, "SmoothL1Loss" in kinds) == ((False, True) if recipe == "adam" else (True, False))


def test_by_the_papers_recipe_a_net_is_its_file_with_other_data() -> None:
    derived, own = derived_net("ours", RECIPES["paper"], LISTS), prototxt.parse_file(PROTOTXT / NETWORKS["ours"])
    changed = [(str(a), str(b)) for a, b in zip(layers_of(derived), layers_of(own)) if str(a) != str(b)]
    assert len(changed) == 2 and all('"HDF5Data"' in a for a, _ in changed)
    assert "batch_size: 512" in changed[0][0] and "batch_size: 256" in changed[1][0] and "shuffle" in changed[0][0]


def test_our_recipes_net_is_that_for_synthetic_hands() -> None:
    """Only the data, the augmentation and the second head differ from the net for synthetic hands."""
    ours, others = PROTOTXT / "synthetic_train_test.prototxt", ("data", "augment", "direct", "direct_loss")
    wanted = [str(layer) for layer in layers_of(prototxt.parse_file(ours)) if text_of(layer, "name") not in others]
    assert [str(layer) for layer in layers_of(derived_net("ours", RECIPES["adam"], LISTS))][2:] == wanted


def test_the_weight_of_physlimit() -> None:
    net = derived_net("ours", RECIPES["paper"], LISTS)
    set_limit(net, 10.0, "L2")
    *_, limit = layers_of(net)
    assert (text_of(limit, "type"), text_of(limit, "loss_weight")) == ("PhysLimit", "10.0") and "L2" in str(limit)
    with pytest.raises(NetlibError, match="no PhysLimit"):
        set_limit(derived_net("direct_joint", RECIPES["paper"], LISTS), 10.0, "L2")


def test_the_papers_solver() -> None:
    """The rate is the paper's for nine tenths of the iterations, then a tenth of it."""
    ((last, tree),) = solvers(RECIPES["paper"], 4000, {"net": Path('a "b".prototxt'), "random_seed": 3})
    solver = schema.read(tree, messages.SolverParameter, "solver")
    paper = solver_parameter.read(RECIPES["paper"].solver)
    assert last == solver.max_iter == 4000 and solver.net == 'a "b".prototxt' and solver.random_seed == 3
    assert (solver.momentum, solver.type, solver.test_iter, solver.snapshot) == (paper.momentum, paper.type, (), 0)
    assert learning_rate(solver, 3599) == paper.base_lr
    assert learning_rate(solver, 3600) == pytest.approx(paper.base_lr / 10)


def test_our_recipe_falls_in_a_straight_line() -> None:
    """The rate is constant after its rise, then falls linearly from there to 0."""
    (branch, first), (last, second) = solvers(RECIPES["adam"], 20000, {})
    trunk, end = (schema.read(tree, messages.SolverParameter, "solver") for tree in (first, second))
    assert (branch, trunk.max_iter, last, end.max_iter) == (14000, 14000, 20000, 20000)
    assert learning_rate(trunk, 500) == pytest.approx(0.001) and learning_rate(trunk, 13999) == pytest.approx(0.002)
    assert [learning_rate(end, i) for i in (14000, 17000, 20000)] == pytest.approx([0.002, 0.001, 0])


def test_thirty_components_are_nearly_all_of_a_hand(tmp_path: Path) -> None:
    """For 64 hands of all sizes, 30 components lose less than 2.5 mm per joint; the components have unit variance."""
    joints = Generator(0).block(0).joint.astype(np.float64)
    for n, some in enumerate(np.array_split(joints, 2)):
        write_hdf5(tmp_path / f"{n}.h5", joint=some)
    write_components(tmp_path / "components.caffemodel.h5", [tmp_path / "0.h5", tmp_path / "1.h5"])
    with h5py.File(tmp_path / "components.caffemodel.h5") as file:
        basis, mean = file["data/joints/0"][...].astype(np.float64), file["data/joints/1"][...]
    assert basis.shape == (93, 30) and mean == pytest.approx(joints.mean(axis=0), abs=1e-6)
    numbers = (joints - mean) @ np.linalg.pinv(basis).T
    assert numbers.std(axis=0) == pytest.approx(np.ones(30), abs=1e-3)
    lost = np.linalg.norm((numbers @ basis.T + mean - joints).reshape(-1, 31, 3), axis=2) * 150
    assert lost.mean() < 2.5


# ---------------------------------------------------------------------------------------------- scores

SKELETON = skeleton.load()
FRAMES = Generator(5, "test").block(0)
assert FRAMES.dof is not None
INPUTS = FRAMES.dof[:24].astype(np.float64)
HALF_CUBE = np.where(np.arange(24) % 8 < 4, 150.0, 130.5)


def predicted(inputs: np.ndarray, bones: np.ndarray | None = None) -> Predictions:
    """The predictions of a network with a hand model, for hands of these bones."""
    kinematics = kinematics_of(SKELETON)
    joints = kinematics.joints(inputs)
    return Predictions(joints, kinematics.joints(INPUTS, bones), inputs, joints, HALF_CUBE, {}, "a test")


def angles(predictions: Predictions) -> np.ndarray:
    return angles_of(predictions, SKELETON, lambda done: None)


def test_scores_of_a_perfect_network() -> None:
    """True joints have no error, with true or with fitted angles, except for angles that joints do not determine."""
    perfect = predicted(INPUTS)
    row = scores(perfect, angles(perfect), INPUTS, INPUTS, None, SKELETON)
    assert row == {"error": "0.00", "cube of 300": "0.00", "cube of 261": "0.00", "fitted angles": "0.00°",
                   "exact angles": "0.00°", "out of limits": "0.0%", "max <= 40": "100.0%"}
    bare = replace(perfect, dof=None)
    row = scores(bare, angles(bare), INPUTS, None, None, SKELETON)
    assert (row["error"], row["exact angles"], row["out of limits"]) == ("0.00", "–", "–")
    assert float(row["fitted angles"].rstrip("°")) < 2


def test_mm_are_those_of_the_frames_cube() -> None:
    """A tenth of a half-cube is 15 mm for one subject and 13.05 mm for the other; the total error is the mean."""
    moved = INPUTS.copy()
    moved[:, SKELETON.dof_names.index("palm_x")] += 0.1
    row = scores(predicted(moved), moved, INPUTS + 0.01, INPUTS, None, SKELETON)
    assert [float(row[name]) for name in ("error", "cube of 300", "cube of 261")] == pytest.approx([14.025, 15, 13.05],
                                                                                                   abs=0.006)
    assert row["exact angles"] == "0.00°" and float(row["fitted angles"].rstrip("°")) > 0.2


def test_what_bones_give_back() -> None:
    """True angles are right on the person's bones; a common factor is enough only if all bones differ by the same."""
    one = np.tile(SKELETON.bones * 1.1, (24, 1))
    several = one * np.random.default_rng(0).uniform(0.9, 1.1, one.shape)
    for bones, scaled_is_enough in ((one, True), (several, False)):
        row = scores(predicted(INPUTS, bones), INPUTS, INPUTS, INPUTS, bones, SKELETON)
        assert float(row["error"]) > 3 and row["person's bones"] == "0.00"
        assert (row["scaled hand"] == "0.00") == scaled_is_enough
        assert float(row["scaled hand"]) < float(row["error"])
