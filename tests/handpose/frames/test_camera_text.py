"""handpose/frames/camera_text.py: texts as plain values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from handpose.frames.camera_text import parse_document


@pytest.mark.parametrize(
    "text",
    [
        "a:\n- 1\n- -2.5e+3\ng: # h\nl:\n  m:\n    n: [3.5, .5e-1,\n      4]\n  o: -0.5\n"
        "'p q': [[1, 2],\n  [3, 4]]\ns: t u\n",
        '%YAML 1.1\n---\na:\n  - 1\n  - 2\nb: {c: 2, d: [1, 2], e: "f"}\n...\nb: 1\n',
    ],
)
def test_yaml(text: str) -> None:
    """Numbers, texts and objects as a reader of YAML has them."""
    yaml = pytest.importorskip("yaml")

    def flat(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: flat(inner) for key, inner in value.items()}
        rows = np.array(value, object).ravel().tolist() if isinstance(value, list) else value
        return rows

    assert flat(parse_document(text, "x")) == flat(next(yaml.safe_load_all(text)))
