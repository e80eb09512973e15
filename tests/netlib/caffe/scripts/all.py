"""Run each script named on the command line in turn, as the main program; print the name of each that ends."""

import runpy
import sys
import traceback

import nets

nets.write()
for name in sys.argv[1:]:
    try:
        runpy.run_path(f"{sys.path[0]}/{name}.py", run_name="__main__")
        print(f"done: {name}")
    except Exception:
        traceback.print_exc(file=sys.stdout)
