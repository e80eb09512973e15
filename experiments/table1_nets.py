"""The nets and solvers of Table 1, derived from the files in prototxt/ by a recipe."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from netlib.errors import NetlibError
from netlib.files.paths import ROOT
from netlib.proto import prototxt
from netlib.proto.prototxt import Message, Scalar
from netlib.training import solver_parameter

PROTOTXT = ROOT / "prototxt"
TEST_BATCH = 256
# loss weight of a SmoothL1Loss with sigma 10, as in synthetic_train_test.prototxt
ROBUST_WEIGHT = 0.1
ROBUST = "smooth_l1_loss_param { sigma: 10 }"
# The files of the networks, in prototxt/.
NETWORKS = {
    "direct_joint": "table1/direct_joint.prototxt",
    "direct_parameter": "table1/direct_parameter.prototxt",
    "no_limit": "table1/no_limit.prototxt",
    "ours": "nyu_train_test.prototxt",
    "bottleneck": "table1/bottleneck.prototxt",  # DeepPrior's
    "direct_parameter_exact": "table1/direct_parameter.prototxt",
    "ours_scale": "table1/ours_scale.prototxt",
    "ours_bones": "table1/ours_bones.prototxt",
}


class Recipe(NamedTuple):
    """A solver, and its changes to a net.

    solver  file
    length  iterations by default
    end     fraction of the iterations with a decreasing rate
    batch   frames of an iteration
    robust  SmoothL1Loss, no dropout, FC2 filled by xavier, as in synthetic_train_test.prototxt
    """

    solver: Path
    length: int
    end: float
    batch: int
    robust: bool


RECIPES = {
    "adam": Recipe(PROTOTXT / "synthetic_solver.prototxt", 30_000, 0.3, batch=64, robust=True),
    "paper": Recipe(PROTOTXT / "nyu_solver.prototxt", 10_000, 0.1, batch=512, robust=False),
}


# -------------------------------------------------------------------------------------------- nets


def derived_net(network: str, recipe: Recipe, lists: dict[str, Path]) -> Message:
    """A network's file with other data and the recipe's changes; its ``str`` is a prototxt.

    Raises PrototxtError.
    """
    net = prototxt.parse_file(PROTOTXT / NETWORKS[network])
    for layer in layers_of(net):
        if layer.text("type") == "HDF5Data":
            _set_data(layer, recipe, lists)
        elif recipe.robust and layer.text("type") == "EuclideanLoss":
            loss_weight = ROBUST_WEIGHT * float(layer.text("loss_weight"))
            _put(layer, f'type: "SmoothL1Loss" loss_weight: {loss_weight} {ROBUST}')
        elif recipe.robust and layer.text("name") == "FC2":
            _put(_part(layer, "inner_product_param"), 'weight_filler { type: "xavier" }')
    if recipe.robust:
        dropout = [id(layer) for layer in layers_of(net) if layer.text("type") == "Dropout"]
        net.fields = [field for field in net.fields if id(field.value) not in dropout]
    return net


def _set_data(layer: Message, recipe: Recipe, lists: dict[str, Path]) -> None:
    """Let a layer read the files of the list for its phase."""
    phase = _part(layer, "include").text("phase")
    block = _part(layer, "hdf5_data_param")
    source = Scalar("string", str(lists[phase.lower()].absolute()), block.position)
    batch = recipe.batch if phase == "TRAIN" else TEST_BATCH
    _put(block, f"source: {source} batch_size: {batch}")


def set_limit(net: Message, loss_weight: float, norm: str) -> None:
    """Change the weight and norm of the net's PhysLimit. Raises NetlibError if it has none."""
    found = [layer for layer in layers_of(net) if layer.text("type") == "PhysLimit"]
    if not found:
        raise NetlibError(
            "this network has no PhysLimit; expected one with it for --limit-weight and --limit-norm"
        )
    _put(found[0], f"loss_weight: {loss_weight} phys_limit_param {{ norm: {norm} }}")


def layers_of(net: Message) -> Iterator[Message]:
    """The layers of a net."""
    return (
        field.value
        for field in net.fields
        if field.name == "layer" and isinstance(field.value, Message)
    )


def _part(message: Message, name: str) -> Message:
    """The first message of this name in a message, which must have one."""
    return next(value for value in message.values(name) if isinstance(value, Message))


def _put(message: Message, fields: str) -> None:
    """Set fields, each in the place of the one of its name, or at the end."""
    for new in prototxt.parse(fields).fields:
        places = [i for i, old in enumerate(message.fields) if old.name == new.name]
        if places:
            message.fields[places[0]] = new
        else:
            message.fields.append(new)


# ----------------------------------------------------------------------------------------- solvers


def solvers(recipe: Recipe, length: int, own: dict[str, object]) -> list[tuple[int, Message]]:
    """The solvers of a training run, one after the other, each with its last iteration.

    Raises PrototxtError.

    own  fields of the solvers; a path becomes a string, other values are prototxt text
    """
    begin = length - max(1, int(length * recipe.end))
    if not recipe.robust:
        return [(length, _solver(recipe, stepvalue=begin, max_iter=length, **own))]
    # poly falls from base_lr at iteration 0 to 0 at max_iter; at ``begin`` it equals the
    # constant rate.
    rate = solver_parameter.read(recipe.solver).base_lr / (1 - begin / length)
    return [
        (begin, _solver(recipe, lr_policy='"fixed"', max_iter=begin, **own)),
        (length, _solver(recipe, base_lr=rate, rampup_interval=0, max_iter=length, **own)),
    ]


def _solver(recipe: Recipe, **own: object) -> Message:
    """The recipe's solver with other fields, without tests and snapshots."""
    solver = prototxt.parse_file(recipe.solver)
    kept = [
        field
        for field in solver.fields
        if not field.name.startswith(("test_", "snapshot")) and field.name not in own
    ]
    for name, value in own.items():
        if isinstance(value, Path):
            value = Scalar("string", value.as_posix(), solver.position)
        kept += prototxt.parse(f"{name}: {value}").fields
    return Message(kept, solver.position)
