# make         say what there is to make
# make demo    set up, find and fit hands in rendered depth frames with the packaged weights (seconds)
# make train   set up, render the training data, train the paper's network for a few minutes, show the result
# make person  the same for a person instead of a hand, in ten minutes; make arm: for a planar arm, in one
# make test    set up and run the tests (ORDER=random: in random order, with a seed to repeat it)
# make kernels the tests of predictions, depth fits and figures again, with the slowest BLAS kernels and NumPy's SIMD off
# make faults  fault injection: tens of thousands of cases with kills, damaged files, full disks (half an hour; CASES=100: short)
# make docs    generates what documents take from the code: code, figures, exercises
# make book    the chapters as notebooks, in build/book
# make site    all documents and the code as a site in site/, links checked (SERVE=1 shows it and follows changes)
# make lint    the style and type checks of the continuous integration, spelling and wording
#
# ITERATIONS=N and FRAMES='--train N --test N' make train, person and arm shorter or longer; OPTIONS='...' goes to the
# program of demo or docs.
PYTHON ?= python3
# Hundreds of processes are started by the tests; without compiled files each compiles all that it imports.
unexport PYTHONDONTWRITEBYTECODE
CASES ?= 1500
BIN := .venv/bin
RUN := $(BIN)/python
SOLVER := prototxt/nyu_solver.prototxt
SNAPSHOT = snapshots/nyu_iter_$(ITERATIONS).caffemodel.h5

.PHONY: help demo train person arm test kernels docs book site faults lint clean

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

person: FRAMES := --train 40000
arm: FRAMES := --train 5000 --test 1000
person arm: .venv/tools
	$(RUN) tools/make_synthetic.py --body prototxt/body/$@_prior.prototxt $(FRAMES)
	$(RUN) tools/show_data.py data/$@/test.txt --skeleton prototxt/body/$@.prototxt --out data/$@/frames.png
	$(RUN) tools/train.py prototxt/body/$@_solver.prototxt $(if $(ITERATIONS),--max-iter $(ITERATIONS)) --log snapshots/$@.log
	$(RUN) tools/test.py $$(ls -t snapshots/$@_iter_*.caffemodel.h5 | head -n 1) --joints \
		--model prototxt/body/$@_train_test.prototxt --picture snapshots/$@.png
	$(RUN) tools/plot_log.py snapshots/$@.log --out snapshots/$@_curves.png
	@echo
	@echo "Pictures: data/$@/frames.png, snapshots/$@.png (predictions), snapshots/$@_curves.png (the training)."

test: .venv/test
	$(RUN) -m pytest -n auto --dist worksteal $(if $(ORDER),--order $(ORDER))

# As on a processor without AVX. NumPy refuses names of features that it does not have, so it is asked for those.
# These are the tests whose results rounding can change by more than rounding: a depth fit decides which capsule is
# nearest, and a prediction or a figure is compared with that of another machine. Layers and fits to joints are smooth.
# test_processors.py chooses kernels by itself.
SIMD := import numpy; print(*numpy.show_config("dicts").get("SIMD Extensions", {}).get("found", []))
kernels: .venv/test
	OPENBLAS_CORETYPE=Nehalem NPY_DISABLE_CPU_FEATURES="$$($(RUN) -c '$(SIMD)')" $(RUN) -m pytest -n auto \
		--dist worksteal tests/docs/test_made.py tests/handpose/fit tests/handpose/estimate \
		--ignore tests/handpose/fit/joints --ignore tests/handpose/estimate/test_processors.py

faults: .venv/test
	$(RUN) -m tests.faults.campaign --cases $(CASES) $(if $(SEED),--seed $(SEED)) $(if $(ONLY),--only "$(ONLY)")

docs: .venv/tools
	$(RUN) -m docs.making $(OPTIONS)

book: .venv/tools
	$(RUN) -m docs.making.notebooks

site: .venv/docs
ifdef SERVE
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs serve
else
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict
endif

# Documents and packages whose spelling and wording codespell checks (setup.cfg, docs/wording.txt). Some words are names
# in the code.
WORDED := README.md CHANGELOG.md CONTRIBUTING.md web/README.md docs/*.md docs/book docs/results docs/exercises/README.md models prototxt \
	tests/caffe/README.md
WORDED_CODE := netlib layers fast handpose exercises experiments export tools docs/making
NAMES := mot,nd,trainings
lint: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/codespell $(WORDED)
	$(BIN)/codespell --ignore-words-list $(NAMES) $(WORDED_CODE)

.venv/tools .venv/test .venv/docs .venv/dev: setup.cfg
	@test -x $(RUN) || $(PYTHON) -m venv .venv
	$(RUN) -m pip install --quiet --disable-pip-version-check -e '.[$(notdir $@)]'
	@touch $@

clean:
	rm -rf .venv build site *.egg-info
