"""Data of docs/momentum.html: where the page begins. The browser computes the paths, for any valley and start."""

from __future__ import annotations

from typing import Any

from docs.making.figures.learning import START, STEEP, STEPS


def data() -> dict[str, Any]:
    """The valley and the start of chapter 6, and the number of steps."""
    return {"start": START, "kappa": float(STEEP[1] / STEEP[0]), "steps": STEPS}
