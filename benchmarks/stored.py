"""Stored benchmark results, one file per kind of machine, and comparison with them.

Times on different machines cannot be compared, and times on one machine vary with the load of its host. Ratios to other
libraries, timed alternately with this project, vary little. So only ratios are stored, and they are compared with those
of the same kind of machine.
"""

from __future__ import annotations

import json
import math
import platform
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import netlib
from netlib.errors import DataError
from netlib.files import atomic

RESULTS = Path(__file__).parent / "results"
MIN_CHANGE = 0.03  # relative variation of median ratios between runs

Row = dict[str, Any]


def kind(threads: int) -> str:
    """Describe this machine: processor, number of threads and BLAS kernels."""
    cpuinfo = Path("/proc/cpuinfo")
    models = re.findall(r"^model name\s*:\s*(.+)$", cpuinfo.read_text(), re.MULTILINE) if cpuinfo.exists() else []
    model = models[0] if models else platform.processor() or platform.machine()
    return f"{model}; {threads} threads; {netlib.BLAS_NOTE.split(',')[0]}"


def path_of(kind: str) -> Path:
    """Return the path of the results of this kind of machine."""
    return RESULTS / (re.sub(r"[^a-z0-9]+", "_", kind.lower()).strip("_") + ".json")


def load(path: Path) -> dict[str, Any] | None:
    """Load stored results; None if there are none. Raises DataError if the file is malformed."""
    if not path.exists():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        numbers = [float(row[key]) for row in found["rows"] for key in ("ratio", "noise")]
        names = [row[key] for row in found["rows"] for key in ("what", "peer")] + [found["date"], found["kind"]]
        if all(map(math.isfinite, numbers)) and all(isinstance(name, str) for name in names):
            return dict(found)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        pass
    raise DataError(f"{path}: malformed benchmark results; remove it, or replace it with --store")


def save(path: Path, facts: dict[str, Any], rows: Sequence[Row]) -> None:
    """Store the rows with ratios. Raises OSError if the file cannot be written."""
    ratios = [{key: row[key] for key in ("what", "peer", "ratio", "noise")} for row in rows if "ratio" in row]
    path.parent.mkdir(exist_ok=True)
    atomic.replace_text(path, json.dumps({**facts, "rows": ratios}, indent=1) + "\n")


def slower(rows: Sequence[Row], before: Sequence[Row]) -> list[str]:
    """Return a line for each ratio that decreased by more than the joint noise of both measurements."""
    stored = {(row["what"], row["peer"]): row for row in before}
    lines = []
    for row in rows:
        old = stored.get((row["what"], row.get("peer", "")))
        if old is None:
            continue
        noise = max(MIN_CHANGE, (row["noise"] ** 2 + old["noise"] ** 2) ** 0.5)
        if row["ratio"] < old["ratio"] * (1 - noise):
            lines.append(f"{row['what']}, against {row['peer']}: {row['ratio']:.2f}x, "
                         f"was {old['ratio']:.2f}x (noise {noise:.0%})")
    return lines
