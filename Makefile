PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: install demo demo-train test check bench clean

install: $(INSTALLED)

# PyTorch comes first and by this name alone: asked for together with the rest, a build for graphics cards may be chosen.
$(INSTALLED): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install torch==2.13.0
	$(BIN)/pip install -c constraints.txt -e '.[dev]'
	touch $@

demo: install
	$(BIN)/fairlead demo

# The same from nothing: collects, trains, plans, reports.
demo-train: install
	$(BIN)/fairlead reproduce dragging --preset desk --out runs/desk

test: install
	$(BIN)/pytest

check: install
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/pyright
	$(BIN)/lint-imports

# `make test check` runs the tests once, because make builds a target once an invocation.
check: test

bench: install
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) build dist src/*.egg-info .pytest_cache .ruff_cache .hypothesis .import_linter_cache
