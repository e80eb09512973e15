"""experiments/table1/networks.py"""

from __future__ import annotations

import re
from pathlib import Path

from experiments.table1.networks import LAMBDAS, NETWORKS, NO_LIMIT, OURS
from experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL
from netlib.proto import prototxt


def features(model: Path) -> list[str]:
    """The layers from the depth to FC2, as text."""
    layers = [str(field.value) for field in prototxt.parse_file(model).fields if field.name == "layer"]
    names = [re.search('name: "(.*)"', layer)[1] for layer in layers]  # type: ignore[index]
    return layers[names.index("convL1") : names.index("DropoutFC2") + 1]


def test_the_networks_differ_after_the_features_only() -> None:
    """The layers up to the last hidden one equal the paper's, character by character."""
    one, *others = (features(network.model) for network in NETWORKS)
    assert len(one) == 14 and all(other == one for other in others)


def test_each_setting_has_the_networks_that_it_can_train() -> None:
    """Exact angles exist only for synthetic hands, and sizes are predicted only where they vary."""
    names = {s.name: [n.name for n in NETWORKS if n.is_for(s)] for s in (ONE_HAND, MANY_HANDS, REAL)}
    assert names["nyu"] == ["direct_joint", "direct_parameter", "no_limit", "ours", "bottleneck"]
    assert names["one_hand"] == [*names["nyu"], "direct_parameter_exact"]
    assert names["many_hands"] == [*names["one_hand"], "ours_scale", "ours_bones"]


def test_lambdas_share_what_is_trained_anyway() -> None:
    """Lambda 0 equals "no limit" and lambda 1 equals "ours"; the names of all networks differ."""
    assert LAMBDAS[0] is NO_LIMIT and LAMBDAS[3] is OURS
    assert len({network.name for network in LAMBDAS}) == len(LAMBDAS) == 8
    assert LAMBDAS[-1].limit == (10, "L2") and LAMBDAS[-1].name == "ours_l2_10"
