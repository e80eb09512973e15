"""The table of layer types: files of layers are imported when a net has such a layer, and classes
can be replaced.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from netlib.proto.options import LayerTable
from tests.support.running import run_python

RELU = "activation.relu.ReLU"


def test_a_net_imports_the_layers_that_it_has(tmp_path: Path) -> None:
    """The plain engine imports nothing of fast/."""
    code = (
        "import sys, netlib\n"
        'text = \'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 } } }\'\n'
        'open(\'net.prototxt\', \'w\').write(text + \'layer { name: "y" type: "ReLU" bottom: "x" top: "y" }\')\n'
        "netlib.Net('net.prototxt', netlib.TEST).forward()\n"
        "names = [name for name in sys.modules if name.startswith('layers.') and name.count('.') == 2]\n"
        "print(netlib.threads(), *sorted(names), *[name for name in sys.modules if name.split('.')[0] == 'fast'])"
    )
    loaded = run_python("-c", code, cwd=tmp_path, NETLIB_ENGINE="plain").out.split()
    assert loaded == ["1", "layers.activation.relu", "layers.data.input"]


def test_a_table_is_a_mapping() -> None:
    table = LayerTable({"B": RELU, "A": "data.input.Input"})
    assert (list(table), len(table), "B" in table, "C" in table) == (["B", "A"], 2, True, False)
    assert table["B"] is table["B"]
    assert table["B"].__name__ == "ReLU"
    with pytest.raises(KeyError):
        table["C"]


def test_a_class_can_be_replaced_and_added() -> None:
    table = LayerTable({"A": RELU})
    table["A"] = table["B"] = int
    assert dict(table) == {"A": int, "B": int}
    del table["A"]
    assert list(table) == ["B"]
