"""A description of this machine."""

from __future__ import annotations

import platform
import re
from pathlib import Path

from netlib import engine

CPUINFO = Path("/proc/cpuinfo")  # of Linux


def machine() -> str:
    """The processor, and how many of its cores this process may use."""
    cores = engine.available_cpus()
    return f"{_processor()}, {cores} core{'s' * (cores != 1)}"


def _processor() -> str:
    try:
        found = re.search(
            r"^model name\s*:\s*(.+)$", CPUINFO.read_text(encoding="utf-8", errors="replace"), re.MULTILINE
        )
    except OSError:
        found = None
    return " ".join(found[1].split()) if found else platform.processor() or platform.machine()
