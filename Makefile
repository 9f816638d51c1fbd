# The two commands: make demo, make test. Both start from nothing (Python 3.11 to 3.13, git and make) and are quick
# the second time. Another interpreter: make setup PYTHON=python3.12

PYTHON ?=
export PYTHON
# Every start of the command line imports all plugins; where this is set, each start compiles them anew.
unexport PYTHONDONTWRITEBYTECODE

VENV := .venv
export VENV
BIN := $(VENV)/bin
comma := ,
PYTEST := PYTHONPATH=scripts $(BIN)/python -m pytest -p no_skips
PYTHON_CODE := bench methods datasets metrics conf tests scripts

# CGAL has no build for Python 3.13: there the demo has the methods that need none, instead of cells that are skipped.
WITHOUT_CGAL = $(shell $(BIN)/python -c "import CGAL" 2>/dev/null || echo method=poisson,ball_pivoting,rimls,apss,identity,noise)

.DEFAULT_GOAL := help
.PHONY: help setup demo real test quick test_setup bench lint doctest wheel clean distclean

help: ## this list
	@awk -F ':.*## ' '/^[a-z][a-z0-9. -]*:.*## / { sub(/ .*/, "", $$1); printf "make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## .venv with the pinned packages and this package (editable); system libraries where apt may install them
	@scripts/setup.sh

demo: setup ## a small sweep over procedural shapes, and its leaderboard
	$(BIN)/detailbench run experiment=demo results=results/demo hydra/launcher=joblib hydra.launcher.n_jobs=2 $(WITHOUT_CGAL)

real: setup ## download the shapes of dataset=real (36 MB) into ~/.cache/detailbench; no test needs them
	$(BIN)/detailbench fetch real

test_setup:
	@scripts/setup.sh --tests

test: test_setup ## all tests; a skipped test counts as a failure
	@# four at a time on two cores, because some tests wait for limits to pass
	$(PYTEST) -n 4 --dist loadfile --no-loadscope-reorder tests --ignore=tests/benchmarks
	@# alone, because they compare times; `make bench` has them in full
	DETAILBENCH_SHORT=1 $(PYTEST) tests/benchmarks -m "not study" --benchmark-disable-gc --benchmark-min-rounds=1 --benchmark-max-time=0.1

quick: test_setup ## some tests of every room and of every family of plugins, in a minute and a half; see tests/quick.txt
	$(PYTEST) -n 2 --dist loadfile @tests/quick.txt

bench: setup ## the benchmarks, with their tables
	$(PYTEST) tests/benchmarks -s

lint: setup ## ruff: style and format; mypy: types
	$(BIN)/ruff check $(PYTHON_CODE)
	$(BIN)/ruff format --check $(PYTHON_CODE)
	$(BIN)/mypy

doctest: setup ## the examples in docstrings
	@# By the names that they are imported by, and only the files that have some: importing the others takes a minute.
	$(PYTEST) -q --doctest-modules $$(grep -rlE --include='*.py' '^ *>>> ' bench bench/methods/ bench/datasets/ bench/metrics/)

wheel: setup ## dist/detailbench-*.whl
	rm -rf build # setuptools would pack what older builds left there
	$(BIN)/python -m build --wheel --no-isolation --outdir dist
	rm -rf build

# --- documentation, releases, other versions of Python ----------------------------------------------------------------

# What an extra of pyproject.toml lacks: $(call extra,NAME,IMPORTS)
extra = @$(BIN)/python -c "import $(2)" 2>/dev/null || $(BIN)/python -m pip install -q -c constraints.txt --no-build-isolation -e ".[$(1)]"

.PHONY: docs changes release-notes hooks test-3.11 test-3.12 test-3.13

docs: setup ## the documentation as a site that opens from the disk: build/site/index.html
	$(call extra,docs,furo$(comma) myst_parser$(comma) sphinx)
	rm -rf build/site
	$(BIN)/python -m sphinx -b html -c docs -d build/doctrees -W --keep-going -q . build/site
	@echo "build/site/index.html"

changes: setup ## the notes of the next release, from changes/*.md; nothing is written
	$(call extra,release,towncrier$(comma) pre_commit)
	@$(BIN)/towncrier build --draft

release-notes: setup ## move changes/*.md into CHANGELOG.md, below the version of bench/__init__.py
	$(call extra,release,towncrier$(comma) pre_commit)
	$(BIN)/towncrier build

hooks: setup ## check style, files and links before each commit (.pre-commit-config.yaml)
	$(call extra,release,towncrier$(comma) pre_commit)
	$(BIN)/pre-commit install

# Each in an environment of its own; .venv stays as it is.
test-3.11 test-3.12 test-3.13: ## all tests with Python 3.11, in .venvs/3.11; so are test-3.12, test-3.13
	@python=$$(scripts/find_python.sh $(@:test-%=%)) && $(MAKE) test VENV=.venvs/$(@:test-%=%) PYTHON="$$python"

# ----------------------------------------------------------------------------------------------------------------------

clean: ## remove caches and what was built, but neither results nor .venv
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .mypy_cache .benchmarks .hypothesis
	find $(PYTHON_CODE) -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean ## clean, and remove .venv and .venvs
	rm -rf .venv .venvs
