"""Ablation: each study changes what its name says, and a finished training is reused only if it is the same."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import h5py
import pytest

from benchmarks import ablation
from handpose.synthetic import recipes
from netlib.proto import prototxt, schema
from netlib.proto.messages import SolverParameter
from netlib.proto.net_parameter import load_parameter
from tests.support.running import run_tool


@pytest.mark.parametrize("name", ablation.STUDIES)
def test_every_study_is_a_net_and_a_solver(name: str) -> None:
    """Each study has a readable net and solver, and all but the first, the recipe, differ from the recipe."""
    recipe = ablation.STUDIES[name][0]
    assert recipe.recipe == recipes.recipe(name)
    assert len({study.name for study in ablation.STUDIES[name]}) == len(ablation.STUDIES[name])
    for study in ablation.STUDIES[name]:
        net, solver = study.net(ablation.NET), study.solver(ablation.SOLVER)
        layers = load_parameter(prototxt.parse(net, study.name)).layer
        assert [layer.name for layer in layers if layer.type == "HandModel"] == ["HandModel"]
        assert all(layer.type == "SmoothL1Loss" for layer in layers if "smooth_l1_loss_param" in layer.blocks)
        schema.read(prototxt.parse(solver, study.name), SolverParameter, "solver")
        same = (net == ablation.NET, solver == ablation.SOLVER, study.rampup == recipe.rampup)
        differs = not all(same) or study.frames != recipe.frames or study.recipe != recipe.recipe
        assert differs == (study is not recipe)


def test_a_training_of_another_recipe_is_not_taken_for_this_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Weights of another recipe are not reused, even under the same name; net and solver beside them must match."""
    trained: list[str] = []

    def train(solver: Path) -> int:
        trained.append(solver.read_text())
        (tmp_path / "recipe_100_seed1_iter_100.caffemodel.h5").touch()
        return 0

    monkeypatch.setattr(ablation.training, "train", train)
    args = argparse.Namespace(work=tmp_path, iterations=100)
    data = (tmp_path / "data.txt", tmp_path / "test.txt")
    for _ in range(2):
        status, weights, net = ablation.trained(ablation.OF_NYU[0], *data, 1, args)
        assert (status, weights.is_file(), net.is_file()) == (0, True, True)
    assert len(trained) == 1
    assert "rampup_interval: 10\n" in trained[0]
    solver = tmp_path / "recipe_100_seed1.prototxt"
    solver.write_text(f"# written otherwise\n\n{solver.read_text()}")
    ablation.trained(ablation.OF_NYU[0], *data, 1, args)
    assert len(trained) == 1
    monkeypatch.setattr(ablation, "SOLVER", ablation.SOLVER.replace("base_lr: 0.002", "base_lr: 0.1"))
    ablation.trained(ablation.OF_NYU[0], *data, 1, args)
    assert len(trained) == 2
    assert "base_lr: 0.1\n" in trained[1]
    for count in (3, 4):  # the data were regenerated, as by another version of the generator
        for _ in range(2):
            with h5py.File(tmp_path / "data.h5", "w") as file:
                file.attrs["recipe"] = f"version {count}"
            _, _, net = ablation.trained(ablation.OF_NYU[0], *data, 1, args)
            assert len(trained) == count
    load_parameter(prototxt.parse(net.read_text(), "net"))


def test_a_benchmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep_threads: None) -> None:
    """The table has a row for each study with the error of each seed; a second run trains nothing."""
    monkeypatch.setattr(ablation, "HELD_OUT", 2)
    monkeypatch.setattr(ablation, "NET", re.sub(r"batch_size: \d+", "batch_size: 2", ablation.NET))
    options = ["--work", str(tmp_path), "--frames", "2", "--iterations", "1", "--seeds", "1", "--only", "plain"]
    rows = run_tool("benchmarks.ablation", *options).out.splitlines()[-3:]
    assert rows[:2] == ["| | 14 joints, mm | by seed |", "|---|---|---|"]
    assert rows[2].startswith("| no augmentation | ")
    monkeypatch.setattr(ablation.training, "train", lambda solver: 1 / 0)
    assert run_tool("benchmarks.ablation", *options).out.splitlines()[-1] == rows[2]


def test_a_study_that_does_not_exist() -> None:
    """An unknown study of this recipe is reported in one line with the known ones."""
    done = run_tool("benchmarks.ablation", "--recipe", "cameras", "--only", "sgd", status=2)
    assert "--only sgd: expected recipe, nyu, no_sensor" in done.err
