# `make demo` flies, `make test` checks, `make quick` checks all but whole flights. Everything is installed into .venv,
# in the versions of constraints/*.txt alone, and only if its hash is the one that stands there.

PYTHON ?= python3
BIN := .venv/bin
# Python writes the bytecode of what it imports. To write all of it takes half a minute, most of it for nothing.
INSTALL := $(BIN)/python -m pip install --no-compile --disable-pip-version-check
RESOLVE := uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header --quiet
LOCK := $(RESOLVE) pyproject.toml -

# Each process would compile all sources and rewrite all tests anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test quick check compiled rewritten docs paper control campaign-smoke locked clean

demo: .venv/installed
	$(BIN)/companion demo $(ARGS)

# More workers than cores: flights in real time leave them idle.
test: .venv/tested
	$(MAKE) --jobs 2 --output-sync=target check compiled rewritten
	$(BIN)/python -m pytest -n 5

# One to three minutes, once it has run before.
quick: check
	$(BIN)/python -m pytest -n 3 -m "not slow"

# A flight: it compiles what is compiled once, before the tests would do so side by side.
compiled: .venv/tested
	$(BIN)/companion demo hover --log .cache/warm-up

# The pages and the reference of the Python names as a site, into build/site.
docs: .venv/documented
	rm -rf .cache/pages
	mkdir -p .cache/pages
	cp -r *.md LICENSE docs .cache/pages
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo 'open build/site/index.html, or, to search in it: $(BIN)/python -m http.server --bind 127.0.0.1 --directory build/site'

# pytest rewrites the tests' assertions once, before each worker would. What it finds wrong the tests will say.
rewritten: .venv/tested
	-$(BIN)/python -m pytest --collect-only >/dev/null

# The paper's experiments, into docs/paper.md.
paper: .venv/tested
	$(BIN)/python -m studies paper

# What the default controller adds to it, into docs/control.md.
control: .venv/tested
	$(BIN)/python -m studies control

# 40 short flights on two workers, one of which is killed meanwhile: all rows are there.
campaign-smoke: .venv/tested
	$(BIN)/python -m studies.campaigns.smoke

# Formatting, lint, types, import contracts.
check: .venv/tested
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

.venv/bin/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Courier needs Python 3.11 or newer: make PYTHON=python3.12 ...")'
	$(PYTHON) -m venv .venv

.venv/installed: .venv/bin/python pyproject.toml constraints/run.txt
	$(INSTALL) --require-hashes --requirement constraints/run.txt
	$(INSTALL) --no-deps --no-build-isolation --editable .
	touch $@

# MAVProxy without what its maps need, and an older MAVSDK beside the one of the environment: strangers to the vehicle.
.venv/tested: .venv/installed constraints/dev.txt constraints/mavproxy.txt constraints/mavsdk-3.txt
	$(INSTALL) --require-hashes --requirement constraints/dev.txt
	$(INSTALL) --require-hashes --no-deps --requirement constraints/mavproxy.txt
	rm -rf .venv/mavsdk-3
	$(INSTALL) --require-hashes --no-deps --target .venv/mavsdk-3 --requirement constraints/mavsdk-3.txt
	touch $@

.venv/documented: .venv/installed constraints/docs.txt
	$(INSTALL) --require-hashes --requirement constraints/docs.txt
	touch $@

# After a change of the dependencies: the locks, with uv. Versions stay as they are where they may.
locked:
	echo 'setuptools>=77' | $(LOCK) --output-file constraints/run.txt
	echo 'setuptools>=77' | $(LOCK) --extra dev --constraint constraints/run.txt --output-file constraints/dev.txt
	echo 'setuptools>=77' | $(LOCK) --extra dev --extra peers --constraint constraints/dev.txt --output-file constraints/peers.txt
	echo 'setuptools>=77' | $(LOCK) --extra docs --constraint constraints/dev.txt --output-file constraints/docs.txt
	echo 'mavproxy' | $(RESOLVE) - --no-deps --output-file constraints/mavproxy.txt
	printf 'mavsdk<4\ngrpcio\n' | $(RESOLVE) - --no-deps --output-file constraints/mavsdk-3.txt

clean:
	rm -rf .venv .cache build *.egg-info
