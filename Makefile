# make setup   an environment in .venv with everything (again: does nothing)
# make demo    a sentence and a picture move a block; look at demo/index.html
# make test    the whole test suite; make lint, make clean

SHELL := /bin/bash
VENV := .venv
STAMP := $(VENV)/.setup-stamp
BIN := $(VENV)/bin
SENTENCE ?= put the red pyramid on the blue cube

# The first Python >= 3.11 that runs and can make an environment; PYTHON=... names another.
PYTHON ?= $(shell for python in python3.12 python3.11 python3.13 python3 python; do \
	$$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' \
	>/dev/null 2>&1 && command -v $$python && break; done)

.PHONY: setup demo test lint clean
.DEFAULT_GOAL := demo

setup: $(STAMP)

$(STAMP): pyproject.toml
	@if [ -z "$(PYTHON)" ]; then \
		found=$$(python3 --version 2>/dev/null || echo no Python); \
		echo "FusionNet needs Python 3.11 or newer with venv; found: $$found. Install it (Debian," \
			"Ubuntu: apt-get install python3 python3-venv) or name one: make $(MAKECMDGOALS)" \
			"PYTHON=/path/to/python3.11" >&2; exit 1; fi
	@[ -x $(BIN)/python ] && $(BIN)/python -m pip --version >/dev/null 2>&1 || \
		{ rm -rf $(VENV) && "$(PYTHON)" -m venv $(VENV); }
	@echo "Installing into $(VENV) (once; some minutes) ..."
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@$(BIN)/fusionnet doctor --mend || true
	@touch $@

demo: setup
	@$(BIN)/fusionnet run "$(SENTENCE)" --corpus examples --scene 1 --out demo

test: setup
	@$(BIN)/python -m pytest -q -n auto --dist worksteal

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

clean:
	rm -rf $(VENV) build dist demo out .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
