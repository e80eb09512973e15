"""experiments/table1/derived_nets.py"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from experiments.table1.derived_nets import layers_of, net_of, text, write_components
from experiments.table1.networks import LAMBDAS, NETWORKS, OURS
from experiments.table1.recipes import ADAM, PAPER, RECIPES
from experiments.table1.settings import ONE_HAND, SETTINGS
from handpose.synthetic.generator import Generator
from netlib.proto import prototxt
from netlib.proto.net_parameter import load_parameter
from tests.support.hdf5_files import write_hdf5

EVERY = [
    (n, s, r) for n in (*NETWORKS, *LAMBDAS[-1:]) for s in SETTINGS.values() if n.is_for(s) for r in RECIPES.values()
]


@pytest.mark.parametrize(("network", "setting", "recipe"), EVERY, ids=lambda part: part.name)
def test_every_net_is_one(network, setting, recipe) -> None:  # type: ignore[no-untyped-def]
    """A printed net parses to the same text and has the data, layers and losses of its setting and recipe."""
    printed = str(net_of(network, setting, recipe))
    param = load_parameter(prototxt.parse(printed))
    folder = "_angles/" if network.labels == "fitted" else "/"
    sources = [str(layer.blocks["hdf5_data_param"].values("source")[0]) for layer in param.layer[:2]]
    assert sources == [f'"{Path.cwd()}/data/{setting.name}{folder}{split}.txt"' for split in ("train", "test")]
    assert str(prototxt.parse(printed)) == printed
    kinds = [layer.type for layer in param.layer]
    assert ("Dropout" in kinds, "SmoothL1Loss" in kinds) == ((False, True) if recipe is ADAM else (True, False))
    assert kinds.count("EuclideanLoss") == 0 or recipe is PAPER


def test_by_the_paper_s_recipe_a_net_is_its_file_with_other_data() -> None:
    """Only the two data layers differ from the network's own file."""
    derived, own = net_of(OURS, ONE_HAND, PAPER), prototxt.parse_file(OURS.model)
    changed = [(str(a), str(b)) for a, b in zip(layers_of(derived), layers_of(own)) if str(a) != str(b)]
    assert len(changed) == 2 and all('"HDF5Data"' in a for a, _ in changed)
    assert "batch_size: 512" in changed[0][0] and "batch_size: 256" in changed[1][0] and "shuffle" in changed[0][0]


def test_our_recipe_s_is_that_for_synthetic_hands() -> None:
    """Only the data, the augmentation and the second head differ from the net for synthetic hands."""
    ours = prototxt.parse_file(ADAM.solver.with_name("synthetic_train_test.prototxt"))
    wanted = [
        str(layer)
        for layer in layers_of(ours)
        if text(layer, "name") not in ("data", "augment", "direct", "direct_loss")
    ]
    assert [str(layer) for layer in layers_of(net_of(OURS, ONE_HAND, ADAM))][2:] == wanted


def test_the_weight_of_physlimit() -> None:
    """PhysLimit has the weight and the norm of the network."""
    *_, limit = layers_of(net_of(LAMBDAS[-1], ONE_HAND, PAPER))
    assert text(limit, "type") == "PhysLimit" and text(limit, "loss_weight") == "10" and "norm: L2" in str(limit)


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
    assert np.linalg.norm((joints - mean).reshape(-1, 31, 3), axis=2).mean() * 150 > 30, "without them"
