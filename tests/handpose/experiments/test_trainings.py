"""handpose/experiments/trainings.py and its networks; more of them in the tests of tools/table1.py"""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path

import h5py
import pytest

from handpose.experiments import trainings
from handpose.experiments.networks import NETWORKS, SOLVER, Network
from netlib import messages, prototxt, schema


def test_other_data_are_other_trainings(tmp_path: Path) -> None:
    """Networks trained on synthetic hands never stand in a table of NYU's."""
    path = tmp_path / "other.h5"
    names = []
    for made_from, recipe in (("synthetic", "a"), ("synthetic", "b"), ("NYU", "b")):
        with h5py.File(path, "w") as file:
            file.attrs.update(made_from=made_from, recipe=recipe)
        names.append(trainings.data_name([path]))
    assert len(set(names)) == 3 and names[2].startswith("nyu_")


@pytest.mark.parametrize("network", NETWORKS, ids=lambda network: network.name)
def test_every_network_is_trained_by_the_papers_solver(network: Network) -> None:
    """With other iterations: the rate falls after nine tenths of them; five snapshots; no tests while training."""
    text = trainings.solver_text(network, Path("snapshots/x"), 2000, 7)
    found = schema.read(prototxt.parse(text), messages.SolverParameter, "solver")
    paper = schema.read(prototxt.parse_file(SOLVER), messages.SolverParameter, "solver")
    own = {
        "net": network.model.as_posix(),
        "max_iter": 2000,
        "stepvalue": (1800,),
        "snapshot": 400,
        "snapshot_prefix": "snapshots/x",
        "random_seed": 7,
        "display": 100,
        "test_iter": (),
        "test_interval": 0,
    }
    assert asdict(found) == {**asdict(paper), **own}


def features(model: Path) -> list[str]:
    """The layers from the depth to FC2, as text."""
    layers = [str(field.value) for field in prototxt.parse_file(model).fields if field.name == "layer"]
    names = [re.search('name: "(.*)"', layer)[1] for layer in layers]
    return layers[names.index("convL1") : names.index("DropoutFC2") + 1]


def test_the_networks_differ_after_the_features_only() -> None:
    """Up to the last hidden layer all are the paper's, to the letter."""
    models = [network.model for network in NETWORKS]
    one, *others = (features(model) for model in models)
    assert len(one) == 14 and all(other == one for other in others)
