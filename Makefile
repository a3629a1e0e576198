# Plain words for the daily work. Only Python (>= 3.11) and make are needed.
PYTHON ?= python3
BIN := .venv/bin
# The environment of the peers that benchmarks run beside the package.
BENCH ?= .venv-bench
NOISE := --disable-pip-version-check --quiet
# The time that a release carries in place of the clock's, so that two builds are the same bytes.
WHEN = $(shell git log -1 --format=%ct 2>/dev/null || date -r CHANGELOG.md +%s)
# Processes that the tests start would compile every module anew.
unexport PYTHONDONTWRITEBYTECODE
# pip compiles what it copies, and no editable package: where Python may write no byte code, each command would compile it.
COMPILED = $(BIN)/python -m compileall -q -j 0 src
PARALLEL := -n auto --maxprocesses 8 --dist worksteal

.PHONY: demo test test-all coverage lint type imports check benchmark docs notebooks release constraints clean

demo: .venv/core  ## the whole job on an industrial arm, into ./dynident-demo
	$(BIN)/dynident demo --out dynident-demo

test: .venv/dev  ## the tests (under 8 minutes on 2 cores)
	$(BIN)/python -m pytest -q $(PARALLEL) -m "not battery"

test-all: .venv/dev  ## the tests and the long batteries
	$(BIN)/python -m pytest -q $(PARALLEL)

coverage: .venv/coverage  ## the branches that the tests take, into docs/laws.md; a run that was stopped goes on
	$(BIN)/python scripts/branches.py

lint: .venv/dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python scripts/words.py

type: .venv/dev
	$(BIN)/pyright --threads 2

imports: .venv/dev
	$(BIN)/lint-imports

check: lint type imports test

benchmark: $(BENCH)/ready  ## speed beside the peers: every row, its JSON and the table of docs/performance.md
	$(BENCH)/bin/python -m benchmarks.speed
	$(BENCH)/bin/python -m benchmarks.speed.scaling

docs: .venv/docs  ## the documentation, into build/docs/index.html: opens without a server, fetches nothing
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

notebooks: .venv/notebooks  ## the notebooks run anew, and their pages in docs/notebooks
	$(BIN)/python scripts/notebooks.py

release: constraints/release.txt constraints/core.txt  ## wheel, sdist and bill of materials, into dist
	$(PYTHON) -m venv --clear build/release
	build/release/bin/python -m pip install $(NOISE) --require-hashes -r constraints/release.txt
	SOURCE_DATE_EPOCH=$(WHEN) build/release/bin/python -m build --no-isolation --outdir dist .
	$(PYTHON) -m venv --clear build/shipped
	build/shipped/bin/python -m pip install $(NOISE) --require-hashes -r constraints/core.txt
	build/shipped/bin/python -m pip install $(NOISE) --no-deps --no-index --find-links dist dynident
	build/release/bin/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml \
	    --output-file dist/dynident.cdx.json build/shipped/bin/python

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv/core: constraints/core.txt pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/core.txt
	$(BIN)/python -m pip install $(NOISE) --no-deps --no-build-isolation -e .
	$(COMPILED)
	touch $@

.venv/dev: constraints/dev.txt pyproject.toml | .venv/bin/python
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/dev.txt
	$(BIN)/python -m pip install $(NOISE) --no-deps --no-build-isolation -e .
	$(COMPILED)
	touch .venv/core $@

.venv/coverage: constraints/coverage.txt .venv/dev
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/coverage.txt
	touch $@

$(BENCH)/ready: constraints/bench.txt pyproject.toml
	$(PYTHON) -m venv $(BENCH)
	$(BENCH)/bin/python -m pip install $(NOISE) --require-hashes -r constraints/bench.txt
	$(BENCH)/bin/python -m pip install $(NOISE) --no-deps --no-build-isolation -e .
	touch $@

.venv/notebooks: constraints/notebooks.txt .venv/dev
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/notebooks.txt
	touch $@

.venv/docs: constraints/docs.txt | .venv/bin/python
	$(BIN)/python -m pip install $(NOISE) --require-hashes -r constraints/docs.txt
	touch $@

constraints:  ## renew the exact versions and hashes (needs uv)
	$(PYTHON) scripts/lock.py

clean:
	rm -rf .venv .venv-bench dist build .pytest_cache .ruff_cache .hypothesis
