# `make demo` and `make test` do all the set-up on a fresh machine: they make .venv and fill it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
STAMP := $(VENV)/.installed

.PHONY: demo test coverage lint kernels figures bench docs clean

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(STAMP)-demo: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e ".[plot]"
	touch $@

$(STAMP)-dev: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e ".[dev]"
	touch $@ $(STAMP)-demo

$(STAMP)-bench: $(STAMP)-dev
	$(PIP) -e ".[bench,dev]"
	touch $@

demo: $(STAMP)-demo  ## a table of agents, curves, replays and a film, in demo/
	$(BIN)/activeloc evaluate --map office:0-3 --agents random,spin,greedy,active \
	    --episodes 8 --steps 100 --seed 1 --jobs 2 --out demo --overwrite --report
	$(BIN)/activeloc run --map office:0 --agent active --seed 1 --out demo/active.gif
	@echo "open demo/report.html: tables, curves and replays; demo/active.gif is a film"

test: $(STAMP)-dev  ## every quick check
	$(MAKE) --no-print-directory -j 2 lint kernels
	$(BIN)/python -m pytest -q -n 2 --dist loadfile

coverage: $(STAMP)-dev  ## the quick checks again, with their coverage: about two minutes longer
	$(BIN)/python -m pytest -q -n 2 --dist loadfile --cov --cov-report=term --cov-fail-under=90

lint: $(STAMP)-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

kernels: $(STAMP)-dev  ## what most tests use, compiled once
	$(BIN)/python tests/compile_kernels.py

figures: $(STAMP)-dev  ## the slow checks, at full sample size
	$(BIN)/python -m pytest -m slow -v -s

bench: $(STAMP)-bench  ## what the parts cost beside what others take: some minutes, into bench/
	$(BIN)/python -m benchmarks --out bench --overwrite

$(STAMP)-docs: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e ".[docs]"
	touch $@

docs: $(STAMP)-docs  ## the site, in site/; a warning or a dead link is an error
	$(BIN)/python docs/site/environments.py --text
	$(BIN)/python docs/site/assemble.py build/site_source
	PYTHONPATH=docs/site $(BIN)/zensical build --strict --clean
	$(BIN)/python docs/site/check_links.py site

clean:
	rm -rf $(VENV) bench build demo site
