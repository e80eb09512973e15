"""A small project for tests of the site."""

from __future__ import annotations

from pathlib import Path

import pytest

FILES = {
    "README.md": "# Small\n\n[net](docs/net.md), [data](docs/data.md)\n\n[relu](layers/relu.py#L3)\n",
    "CHANGELOG.md": "# Changes\n",
    "docs/net.md": "# The net\n\n![x](images/x.png) [a](../layers/relu.py#L4-L6) [b](../layers) [c](../tests/caffe)\n"
    "[weights](../models/w.bin) [gone](gone.md) [above](../../x.md)\n",
    "docs/data.md": "# Data\n\n<!-- code: layers/scale.py Scale -->\n```python\nclass Scale: ...\n```\n",
    "docs/apart.md": "# Apart\n",
    "docs/making/site.py": '"""Not published."""\n',
    "docs/images/x.png": "x",
    "docs/book/README.md": "# The book\n",
    "docs/book/2_two.md": "# Two\n",
    "docs/book/10_ten.md": "# Ten\n",
    "docs/book/1_one.md": "# One\n",
    "layers/__init__.py": '"""The layers, `all`."""\n',
    "layers/relu.py": '"""ReLU: cut off | what is < 0.\n\ny  = max(x, 0)\n"""\n\nfrom layers.scale import Scale\n\n\n'
    'class ReLU(Scale):\n    def forward(self):\n        """Sees scale.py."""\n\n    def _own(self):\n        pass\n',
    "layers/scale.py": '"""Scale (see relu.py and layers/relu.py): nothing."""\n\nclass Scale: ...\n',
    "layers/data/__init__.py": '"""Rooms for data."""\n',
    "layers/data/labels.py": "x = 1\n",
    "layers/data/labels.pyc": "no",
    "fast/relu.py": '"""Faster."""\nfrom layers.relu import ReLU\n',
    "fast/scale.py": '"""Of another."""\n',
    "tests/caffe/README.md": "# Recorded\n\n[up](../../docs/net.md)\n",
    "tests/layers/test_relu.py": '"""Tests of it."""\n',
    "tests/layers/data/test_data_labels.py": '"""Tests of labels."""\n',
    "models/w.bin": "0",
}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """The root folder of the project."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path
