# `make` lists the targets. Each of them does its own set-up, once.
.DEFAULT_GOAL := help
.PHONY: help install demo test test-all test-gpu tables docs notebooks package test-lowest lint clean
.DELETE_ON_ERROR:

PYTHON ?= python3
VENV := .venv
INSTALLED := $(VENV)/.installed
INSTALLING := $(VENV)/.installing
RUN := $(VENV)/bin/python -m
DOCS_VENV := .venv-docs
DOCS_INSTALLED := $(DOCS_VENV)/.installed
# Compiled modules are kept in .venv, whatever the environment says: where Python compiles PyTorch and Lightning anew, each
# command takes ten seconds more, and tests start hundreds of them.
unexport PYTHONDONTWRITEBYTECODE
# Two test processes with one thread each are faster than one with two.
PYTEST := OMP_NUM_THREADS=1 $(RUN) pytest -n 2

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

install: $(INSTALLED) ## make .venv and install the pinned packages and pcnclaws into it

demo: $(INSTALLED) ## make data, train the law of sand, test it on unseen parameters, draw pictures
	$(RUN) pcnclaws.train experiment=sand_multi training=kalman

test: $(INSTALLED) ## run the tests that take seconds
	$(PYTEST) -m "not slow and not gpu"

test-all: $(INSTALLED) ## run all tests that need no GPU
	$(PYTEST) -m "not gpu"

# PyTorch warns of its own means of finding what waits for the GPU.
test-gpu: $(INSTALLED) ## run the tests that need a GPU
	$(RUN) pytest -m gpu -W default tests

tables: $(INSTALLED) ## write the pages of results from the JSON files in docs/results
	$(RUN) benchmarks.pages docs/results/accuracy docs/results.md docs/results/baselines docs/comparison.md
	$(RUN) benchmarks.pages.estimates docs/results/estimation docs/estimation_results.md
	$(RUN) benchmarks.pages.stress docs/results/stress.json docs/stress.md
	$(RUN) benchmarks.pages.real_stress docs/results/real_stress.json docs/real_stress.md
	$(RUN) benchmarks.pages.verification docs/results/verification.json docs/verification.md
	$(RUN) benchmarks.pages.laws docs/laws
	$(RUN) benchmarks.pages.unified docs/results docs/unified.md
	$(RUN) benchmarks.pages.real_beam docs/results/real_beam/real_beam.json docs/real_beam.md

docs: $(DOCS_INSTALLED) ## build the docs site in outputs/site, without warnings
	$(DOCS_VENV)/bin/mkdocs build --quiet --strict
	@echo "open outputs/site/index.html"

notebooks: $(INSTALLED) ## run the notebooks of the docs and keep their results in them
	$(RUN) pip install --quiet --constraint requirements.lock --no-build-isolation --editable '.[notebooks]'
	cd docs/notebooks && ../../$(VENV)/bin/jupyter execute --inplace *.ipynb

package: $(INSTALLED) ## build wheel and source in dist; install each into a clean environment and run every command there
	$(RUN) build --no-isolation --outdir dist .
	$(RUN) pytest tests/test_packaging.py

test-lowest: $(INSTALLED) ## run every command with the lowest versions that pyproject.toml accepts
	VERSIONS=requirements.lowest $(RUN) pytest tests/test_packaging.py -k every_command

lint: $(INSTALLED) ## check style, types and the direction of imports
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/pyright
	$(VENV)/bin/lint-imports

include benchmarks/accuracy.mk
include benchmarks/estimation.mk
include benchmarks/baselines.mk
include benchmarks/unified.mk

clean: ## remove caches and built packages; keeps .venv and outputs
	rm -rf build dist .venv-docs .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find pcnclaws benchmarks tests -name __pycache__ -type d -prune -exec rm -rf {} +

# A set-up that was interrupted leaves INSTALLING behind, and the next one starts afresh. Modules are compiled when they
# are first used, which is a minute less than compiling all of them.
$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "$(PYTHON) is older than Python 3.11; choose another with make PYTHON=..."; exit 1; }
	@if [ -e $(INSTALLING) ] || ! $(RUN) pip --version > /dev/null 2>&1; then \
		rm -rf $(VENV) && $(PYTHON) -m venv $(VENV); fi
	@touch $(INSTALLING)
	$(RUN) pip install --quiet --no-compile --requirement requirements.lock
	$(RUN) pip install --quiet --no-deps --no-build-isolation --editable .
	@rm $(INSTALLING) && touch $(INSTALLED)

# The site reads the source and imports none of it: an environment of its own, without PyTorch.
$(DOCS_INSTALLED): docs/requirements.lock
	rm -rf $(DOCS_VENV) && $(PYTHON) -m venv $(DOCS_VENV)
	$(DOCS_VENV)/bin/python -m pip install --quiet --no-compile --requirement docs/requirements.lock
	@touch $(DOCS_INSTALLED)
