# make         say what there is to make
# make demo    set up, find and fit hands in rendered depth frames with the packaged weights (seconds)
# make train   set up, render the training data, train the paper's network for a few minutes, show the result
# make test    set up and run the tests (ORDER=random: in random order, with a seed to repeat it)
# make kernels the tests of predictions and depth fits again, with the slowest BLAS kernels and NumPy's SIMD off
# make docs    what documents take from the code, pages for the browser, the chapters as notebooks, and the site in site/
#              (SERVE=1 serves the site and follows changes)
# make lint    the style and type checks of the continuous integration, spelling and wording
#
# ITERATIONS=N and FRAMES='--train N --test N' make train shorter or longer; OPTIONS='...' goes to the
# program of demo.
PYTHON ?= python3
# Hundreds of processes are started by the tests; without compiled files each compiles all that it imports.
unexport PYTHONDONTWRITEBYTECODE
BIN := .venv/bin
RUN := $(BIN)/python
SOLVER := prototxt/nyu_solver.prototxt
SNAPSHOT = snapshots/nyu_iter_$(ITERATIONS).caffemodel.h5

.PHONY: help demo train test kernels docs lint clean

help:
	@sed -n '/^#/!q; s/^# //p' $(firstword $(MAKEFILE_LIST))

demo: .venv/tools
	$(RUN) tools/demo.py --out demo $(OPTIONS)

train: ITERATIONS ?= 1000
train: .venv/tools
	$(RUN) tools/make_synthetic.py $(FRAMES)
	$(RUN) tools/train.py $(SOLVER) --max-iter $(ITERATIONS) --log snapshots/train.log
	$(RUN) tools/test.py $(SNAPSHOT) --picture snapshots/hands.png
	$(RUN) tools/plot_log.py snapshots/train.log --out snapshots/curves.png
	@echo
	@echo "Pictures: snapshots/hands.png (predicted hands), snapshots/curves.png (the training)."
	@echo "Train on from here: $(RUN) tools/train.py $(SOLVER) --snapshot $(SNAPSHOT:caffemodel.h5=solverstate.h5)"

test: .venv/test
	$(RUN) -m pytest -n auto --dist worksteal $(if $(ORDER),--order $(ORDER))

# As on a processor without AVX. NumPy refuses names of features that it does not have, so it is asked for those.
# These are the tests whose results rounding can change by more than rounding: a depth fit decides which capsule is
# nearest, and a prediction is compared with that of another machine. Layers and fits to joints are smooth.
# test_processors.py chooses kernels by itself.
SIMD := import numpy; print(*numpy.show_config("dicts").get("SIMD Extensions", {}).get("found", []))
kernels: .venv/test
	OPENBLAS_CORETYPE=Nehalem NPY_DISABLE_CPU_FEATURES="$$($(RUN) -c '$(SIMD)')" $(RUN) -m pytest -n auto \
		--dist worksteal tests/handpose/fit tests/handpose/estimate \
		--ignore tests/handpose/fit/joints --ignore tests/handpose/estimate/test_processors.py

# In a document, the text between <!--cog FUNCTION() cog--> and <!--end--> is what docs/making/generated.py prints.
COG := -P -U -p 'from docs.making.generated import *' --markers='<!--cog cog--> <!--end-->'
docs: .venv/docs
	$(RUN) -m cogapp -r --verbosity=1 $(COG) docs/*.md docs/*/*.md
	$(RUN) -m docs.making.pages
	$(RUN) -m docs.making.notebooks
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs $(if $(SERVE),serve,build --strict)

lint: .venv/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/codespell $$(git ls-files '*.py' '*.md' '*.prototxt' | grep -v '^tests/')

.venv/tools .venv/test .venv/docs .venv/dev: setup.cfg
	@test -x $(RUN) || $(PYTHON) -m venv .venv
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[$(notdir $@)]'
	@touch $@

clean:
	rm -rf .venv build site *.egg-info
