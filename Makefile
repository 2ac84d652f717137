# Two commands for a fresh machine: `make figures` and `make test`.
PYTHON ?= python3
VENV := .venv
CONFIG ?= config/default.yaml
INSTALL := $(VENV)/bin/python -m pip install --quiet --no-build-isolation
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)

.PHONY: figures test test-fast lint setup docs
.DEFAULT_GOAL := figures

figures: setup
	@slapshot config -- "$(CONFIG)"
	snakemake figures --configfile "$(CONFIG)"

# A file of tests stays on one core: its fixtures are made once. The order is that of tests/conftest.py.
test: setup lint
	pytest -n auto --dist loadfile --no-loadscope-reorder

# Without those that run Snakemake.
test-fast: setup
	pytest -n auto --dist loadfile --no-loadscope-reorder -m "not slow and not workflow"

lint: setup
	ruff check .
	ruff format --check .
	mypy
	lint-imports
	snakefmt --check --compact-diff Snakefile workflow
	snakemake --lint

# The site, in build/site. Pages and what they link to are copied with their places in the repository.
docs: setup
	$(INSTALL) --no-deps --require-hashes --requirement requirements/docs.txt
	rm -rf build && mkdir -p build/docs
	git ls-files -z '*.md' LICENSE CITATION.cff Makefile config docs figures pipeline_src workflow requirements \
	    | tar --null -T - -cf - | tar -xf - -C build/docs
	zensical build --strict

setup: $(VENV)/.complete

# The mark is written last, so that an interrupted installation starts again.
# One package is built here, with the tools of build.txt. Where pip is offered PyTorch's build for CPUs alone
# (by PIP_FIND_LINKS or PIP_EXTRA_INDEX_URL), that is taken; elsewhere on Linux torch brings CUDA along.
$(VENV)/.complete: pyproject.toml $(wildcard requirements/*.txt)
	$(PYTHON) -c "import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 13) and 'slapshot needs Python 3.11 or 3.12: make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --require-hashes --requirement requirements/build.txt
	$(INSTALL) --no-deps --require-hashes --requirement requirements/torch-cpu.txt 2>/dev/null || true
	$(INSTALL) --require-hashes --requirement requirements/lock.txt --constraint requirements/cuda.txt
	$(INSTALL) --no-deps --editable .
	touch $@
