# Two commands for a fresh machine: `make figures` and `make test`.
PYTHON ?= python3
VENV := .venv
CONFIG ?= config/default.yaml
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)

.PHONY: figures test lint setup
.DEFAULT_GOAL := figures

figures: setup
	@slapshot config -- "$(CONFIG)"
	snakemake figures --configfile "$(CONFIG)"

test: setup lint
	pytest

lint: setup
	ruff check .
	ruff format --check .
	mypy
	lint-imports
	snakefmt --check --compact-diff Snakefile workflow
	snakemake --lint

setup: $(VENV)/.complete

# The mark is written last, so that an interrupted installation starts again.
$(VENV)/.complete: pyproject.toml constraints.txt
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'slapshot needs Python 3.11 or newer: make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --upgrade pip
	$(VENV)/bin/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch $@
