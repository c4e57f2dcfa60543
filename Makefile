# Works with GNU make 3.81 (macOS) and later.  Needs only python3 (3.10 or newer, with venv) and a package index.
#     make demo        PYTHON=python3.12 make test        make test PYTEST_ARGS='-k attitude'

PYTHON ?= python3
PYTEST_ARGS ?=

BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
VENV := .venv/.stamp-venv
PLOT := .venv/.stamp-plot
TEST := .venv/.stamp-test
BENCH := .venv/.stamp-bench

.PHONY: help demo test check format bench clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-8s %s\n", $$1, $$2 }' Makefile

demo: $(PLOT) ## align a swaying ship: a table, and a figure in demo/
	$(BIN)/insenv run ship-swaying -e q-method --out demo

test: check ## set up, then every check: ruff, mypy, import-linter, pytest
	$(BIN)/python -m pytest -n 2 --dist worksteal $(PYTEST_ARGS)

check: $(TEST) ## the static checks alone
	$(BIN)/ruff check --output-format concise .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(TEST) ## put the source in order (ruff)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(BENCH) ## the benchmarks, each beside its floor and, where it installs, a peer
	$(BIN)/insenv bench

clean: ## remove all that make and the checks made, .venv too
	rm -rf .venv demo build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find insenv tests benchmarks examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# Each stamp marks a step that succeeded; a change of pyproject.toml installs again.

$(VENV):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo "insenv needs Python 3.10 or newer; '$(PYTHON)' is: $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "Name a newer one: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { echo "creating .venv"; $(PYTHON) -m venv --clear .venv; }
	@touch $@

$(PLOT): pyproject.toml $(VENV)
	@echo "installing insenv into .venv (once; some minutes)"
	@$(PIP) install --quiet -e '.[plot]'
	@touch $@

$(TEST): pyproject.toml $(VENV)
	@echo "installing insenv and its checks into .venv (once; some minutes)"
	@$(PIP) install --quiet -e '.[test,plot]'
	@touch $@

$(BENCH): pyproject.toml $(VENV)
	@echo "installing insenv and the peer of its benchmarks into .venv (once; some minutes)"
	@$(PIP) install --quiet -e '.[plot,bench]' || { \
	  echo "pyins (python-ins) does not install here: figures without a peer" >&2; $(PIP) install --quiet -e '.[plot]'; }
	@touch $@
