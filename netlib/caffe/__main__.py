"""Run a script written for pycaffe unchanged: python -m netlib.caffe SCRIPT [ARGUMENT ...]"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

from netlib import install_as_caffe


def main() -> None:
    """Run the script named on the command line, with netlib.caffe importable as ``caffe``."""
    if len(sys.argv) < 2 or sys.argv[1] in ("-h", "--help"):
        print(__doc__)
        sys.exit(0 if len(sys.argv) > 1 else 2)
    if not Path(sys.argv[1]).is_file():
        sys.exit(f"{sys.argv[1]}: script not found")
    install_as_caffe()
    del sys.argv[0]
    sys.path[0] = str(Path(sys.argv[0]).resolve().parent)  # as when Python runs the script
    runpy.run_path(sys.argv[0], run_name="__main__")


if __name__ == "__main__":
    main()
