"""How large a cube around a body may be."""

from __future__ import annotations

CUBES_MM = (50.0, 10_000.0)  # edges: from less than a small hand to several people; in metres they would be smaller
