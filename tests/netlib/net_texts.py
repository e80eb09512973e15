"""Texts of small nets for tests of netlib/."""

from __future__ import annotations

import numpy as np

X = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } } '


def ip(name: str, bottom: str, top: str, more: str = "", outputs: int = 3) -> str:
    """An InnerProduct layer."""
    return (
        f'layer {{ name: "{name}" type: "InnerProduct" bottom: "{bottom}" top: "{top}" {more} '
        f'inner_product_param {{ num_output: {outputs} weight_filler {{ type: "xavier" }} }} }} '
    )


def loss(bottom: str, more: str = "") -> str:
    """A loss on a blob of 2 x 3, against an input ``t``."""
    return (
        'layer { name: "t" type: "Input" top: "t" input_param { shape { dim: 2 dim: 3 } } } '
        f'layer {{ name: "loss" type: "EuclideanLoss" bottom: "{bottom}" bottom: "t" top: "loss" {more} }} '
    )


def rng() -> np.random.Generator:
    """The numbers of these tests."""
    return np.random.default_rng(0)


def shared(mode: str = "", more: str = "") -> str:
    """Two layers whose weights have one name."""
    return (
        X
        + ip("a", "x", "a", 'param { name: "w" lr_mult: 2 decay_mult: 1 }')
        + ip("b", "a", "b", f'param {{ name: "w" {mode} }} {more}')
    )
