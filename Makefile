# Needs GNU make 3.81 (macOS) or later, python3 (3.10 or later, with venv) and internet access to PyPI.
#     make demo        PYTHON=python3.12 make test        make test PYTEST_ARGS='-k attitude'

PYTHON ?= python3
PYTEST_ARGS ?=

BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
# modules are compiled when they are first imported: an installation takes half the time
INSTALL := $(PIP) install --quiet --no-compile
VENV := .venv/.stamp-venv
PLOT := .venv/.stamp-plot
TEST := .venv/.stamp-test
ALL := .venv/.stamp-test-all
BENCH := .venv/.stamp-bench
DOCS := .venv/.stamp-docs
MAVPROXY_TOOLS := MAVProxy==1.8.75 pymavlink==2.4.50 pyserial==3.5 fastcrc==0.5.0 lxml==6.1.3
MAVPROXY := .venv/.stamp-mavproxy-1.8.75

.PHONY: help demo layout test test-all check format consistency mutants bench docs clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

demo: $(PLOT) ## align a swaying ship: print a table, and write a figure to demo/
	$(BIN)/insenv run ship-swaying -e q-method --out demo

# mypy uses one core and runs at the same time as the tests
test: layout ## set up .venv and run the checks of a change: ruff, mypy, import-linter, pytest (4 minutes on two cores)
	@$(BIN)/mypy > .venv/mypy.txt 2>&1 & types=$$!; \
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not slow' $(PYTEST_ARGS); result=$$?; \
	wait $$types || { cat .venv/mypy.txt; exit 1; }; exit $$result

# TARGETS='fmu web' runs some of its targets, AGAIN=1 those that have not passed on this state of the tree: all, after a change;
# as root it installs the peers of Debian
test-all: $(ALL) $(MAVPROXY) ## run everything: slow tests, FMUs, streams, pages, learning, site, mutants; one table at the end (an hour)
	$(BIN)/python tools/test_all.py $(if $(AGAIN),--again) $(TARGETS)

check: layout ## the static checks
	$(BIN)/mypy

layout: $(TEST)
	$(BIN)/ruff check --output-format concise .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

format: $(TEST) ## format the source and fix what ruff can fix
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

consistency: $(TEST) ## NEES of each filter, then all estimators on all scenarios (docs/consistency.md)
	$(BIN)/python tools/consistency.py
	$(BIN)/python tools/matrix.py

mutants: $(TEST) ## inject faults into the physics: the share that the tests find, 10 to 30 minutes
	$(BIN)/python tools/mutants.py $(MUTANTS_ARGS)

bench: $(BENCH) ## benchmarks, with their floors and, if it can be installed, a peer
	$(BIN)/insenv bench

# the tutorials are run again where they or the code have changed (docs/conf.py)
docs: $(DOCS) ## build the documentation site in build/docs/html, and open its pages in headless Chromium
	$(BIN)/python -m sphinx -b html -q -W --keep-going -d build/docs/doctrees docs build/docs/html
	INSENV_SITE=build/docs/html $(BIN)/python -m pytest --noconftest tests/project/test_site.py $(PYTEST_ARGS)

clean: ## remove all generated files, including .venv
	rm -rf .venv .test-all demo build dist .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find insenv tests examples -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# Each stamp marks a completed installation; a change of pyproject.toml repeats it.

$(VENV):
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { \
	  echo "insenv needs Python 3.10 or newer; '$(PYTHON)' is: $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "Give a newer one: make $(MAKECMDGOALS) PYTHON=python3.12" >&2; exit 1; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || { echo "creating .venv"; $(PYTHON) -m venv --clear .venv; }
	@touch $@

$(PLOT): pyproject.toml $(VENV)
	@echo "installing insenv into .venv (once; a few minutes)"
	@$(INSTALL) -e '.[plot]'
	@touch $@

$(TEST): pyproject.toml $(VENV)
	@echo "installing insenv and its checks into .venv (once; a few minutes)"
	@$(INSTALL) -e '.[test,plot]'
	@touch $@

$(ALL): pyproject.toml $(TEST)
	@echo "installing all that tests run beside insenv into .venv (once; some minutes)"
	@$(INSTALL) 'torch==2.13.0+cpu' 2>/dev/null || $(INSTALL) 'torch==2.13.0' 2>/dev/null || true
	@$(INSTALL) -e '.[test,test-all,plot,native,web,ml,cluster,rl,workbench,serial,view,docs]'
	@$(INSTALL) -e '.[bench]' || echo "pyins (python-ins) cannot be installed here: benchmarks without a peer" >&2
	@touch $@

$(BENCH): pyproject.toml $(VENV)
	@echo "installing insenv and the peer of its benchmarks into .venv (once; a few minutes)"
	@$(INSTALL) -e '.[plot,bench]' || { \
	  echo "pyins (python-ins) cannot be installed here: benchmarks without a peer" >&2; $(INSTALL) -e '.[plot]'; }
	@touch $@

$(DOCS): pyproject.toml $(VENV)
	@echo "installing insenv and what its documentation needs into .venv (once; a few minutes)"
	@$(INSTALL) -e '.[docs]'
	@touch $@

# MAVProxy without the packages that only its windows need: a third of the size; numpy is the newest for this Python

$(MAVPROXY): $(VENV)
	@echo "installing MAVProxy into .venv/mavproxy (once)"
	@$(PYTHON) -m venv --clear .venv/mavproxy
	@.venv/mavproxy/bin/python -m pip --disable-pip-version-check install --quiet --no-deps \
	  $(MAVPROXY_TOOLS) numpy
	@touch $@
