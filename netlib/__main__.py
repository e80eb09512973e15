"""The command ``netlib``: ``python -m netlib COMMAND ...``.

The commands are the files of tools/, which import this package; they are found by name.
"""

from __future__ import annotations

import importlib
import sys

from netlib.files.paths import ROOT


def main(program: str = "netlib") -> None:
    """Run the command that the command line names; ``program`` is how the user calls it."""
    # tools/, exercises/ and export/ are not installed as packages
    sys.path.insert(0, str(ROOT))
    importlib.import_module("tools.common.commands").main(program)


if __name__ == "__main__":
    main()
