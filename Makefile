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
MAVPROXY := .venv/.stamp-mavproxy

.PHONY: help demo layout test test-slow test-mavlink test-fmu test-rl check format consistency bench clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

demo: $(PLOT) ## align a swaying ship: a table, and a figure in demo/
	$(BIN)/insenv run ship-swaying -e q-method --out demo

# mypy uses one core: the tests need not wait for it
test: layout ## set up, then every check: ruff, mypy, import-linter, pytest
	@$(BIN)/mypy > .venv/mypy.txt 2>&1 & types=$$!; \
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not slow' $(PYTEST_ARGS); result=$$?; \
	wait $$types || { cat .venv/mypy.txt; exit 1; }; exit $$result

test-slow: $(TEST) ## what compiles for minutes: every estimator in the plant's loop, every environment
	$(BIN)/python -m pytest -n 2 --dist worksteal -m slow $(PYTEST_ARGS)

test-mavlink: $(TEST) $(MAVPROXY) ## the heavy tests of MAVLink: MAVProxy in an environment of its own, long streams
	INSENV_TEST_MAVLINK=1 INSENV_MAVPROXY=.venv/mavproxy/bin/python \
	  $(BIN)/python -m pytest tests/mavlink/test_heavy.py tests/mavlink/test_link.py $(PYTEST_ARGS)

test-fmu: $(TEST) ## the long checks of FMUs: every one of them, 60,000 steps, all platforms (minutes)
	@$(PIP) install --quiet -e '.[test,plot,native]' || echo "ziglang does not install here: this machine's platform alone" >&2
	INSENV_TEST_FMU=1 $(BIN)/python -m pytest -n 2 --dist worksteal tests/fmu $(PYTEST_ARGS)

test-rl: $(TEST) ## train the tuner of docs/tuning-and-manoeuvre.md and compare it on held-out seeds (minutes)
	@$(PIP) install --quiet 'torch==2.13.0+cpu' 2>/dev/null || echo "no wheel of torch without CUDA here: that with it" >&2
	@$(PIP) install --quiet -e '.[test,plot,rl]'
	INSENV_TEST_RL=1 $(BIN)/python -m pytest tests/envs/test_rl.py $(PYTEST_ARGS)

check: layout ## the static checks alone
	$(BIN)/mypy

layout: $(TEST)
	$(BIN)/ruff check --output-format concise .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

format: $(TEST) ## put the source in order (ruff)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

consistency: $(TEST) ## NEES of every filter over 56 seeds, some minutes (docs/consistency.md)
	$(BIN)/python tools/consistency.py

bench: $(BENCH) ## the benchmarks, each beside its floor and, where it installs, a peer
	$(BIN)/insenv bench

clean: ## remove all that make and the checks made, .venv too
	rm -rf .venv demo build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find insenv tests tools examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

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

# MAVProxy without what only its windows need: a third of the size

$(MAVPROXY): $(VENV)
	@echo "installing MAVProxy into .venv/mavproxy (once)"
	@$(PYTHON) -m venv --clear .venv/mavproxy
	@.venv/mavproxy/bin/python -m pip --disable-pip-version-check install --quiet --no-deps \
	  MAVProxy pymavlink pyserial fastcrc lxml numpy
	@touch $@
