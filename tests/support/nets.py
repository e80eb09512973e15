"""Texts of small nets."""

from __future__ import annotations

from collections.abc import Sequence


def inputs(**shapes: Sequence[int]) -> str:
    """Return input layers: ``inputs(x=(2, 3), t=(2,))``."""
    return "".join(
        f'layer {{ name: "{name}" type: "Input" top: "{name}" '
        f"input_param {{ shape {{ {' '.join(f'dim: {n}' for n in shape)} }} }} }} "
        for name, shape in shapes.items()
    )


X = inputs(x=(2, 3))


def ip(name: str, bottom: str, top: str, more: str = "", outputs: int = 3) -> str:
    """Return an InnerProduct layer."""
    return (
        f'layer {{ name: "{name}" type: "InnerProduct" bottom: "{bottom}" top: "{top}" {more} '
        f'inner_product_param {{ num_output: {outputs} weight_filler {{ type: "xavier" }} }} }} '
    )


ONE = X + ip("a", "x", "a")  # nets of one layer, and of two
TWO = ONE + ip("b", "a", "b")


def loss(bottom: str, more: str = "") -> str:
    """Return a loss on a blob of 2 x 3, compared with an input ``t``."""
    return inputs(t=(2, 3)) + (
        f'layer {{ name: "loss" type: "EuclideanLoss" bottom: "{bottom}" bottom: "t" top: "loss" {more} }} '
    )


def shared(mode: str = "", more: str = "") -> str:
    """Return two layers whose weights have the same name."""
    return (
        X
        + ip("a", "x", "a", 'param { name: "w" lr_mult: 2 decay_mult: 1 }')
        + ip("b", "a", "b", f'param {{ name: "w" {mode} }} {more}')
    )
