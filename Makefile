# Plain words for the daily work. Only Python (>= 3.11) and make are needed.
PYTHON ?= python3
BIN := .venv/bin
NOISE := --disable-pip-version-check --quiet
PARALLEL := -n auto --maxprocesses 8 --dist worksteal

.PHONY: demo test test-all lint type imports check benchmark constraints clean

demo: .venv/core  ## the article's case from end to end, into ./dynident-demo
	$(BIN)/dynident demo --out dynident-demo

test: .venv/dev  ## the tests (under 8 minutes on 2 cores)
	$(BIN)/python -m pytest -q $(PARALLEL) -m "not battery"

test-all: .venv/dev  ## the tests and the long batteries
	$(BIN)/python -m pytest -q $(PARALLEL)

lint: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

type: .venv/dev
	$(BIN)/pyright

imports: .venv/dev
	$(BIN)/lint-imports

check: lint type imports test

benchmark: .venv/dev  ## speed and accuracy, side by side with the peers that are installed
	$(BIN)/python -m benchmarks.run

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/core: constraints/core.txt pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/core.txt
	$(BIN)/python -m pip install $(NOISE) --no-deps --no-build-isolation -e .
	touch $@

.venv/dev: constraints/dev.txt pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/dev.txt
	$(BIN)/python -m pip install $(NOISE) --no-deps --no-build-isolation -e .
	touch .venv/core $@

constraints:  ## renew the exact versions and hashes (needs pip-tools)
	$(PYTHON) scripts/lock.py

clean:
	rm -rf .venv dist build .pytest_cache .ruff_cache .hypothesis
