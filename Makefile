# All a newcomer needs: git, make and Python 3.11 or newer. Everything else is installed into .venv.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST := $(BIN)/python -m pytest
# By files, since the tests of a file share what they look at.
PARALLEL := -n logical --maxprocesses 8 --dist loadfile
INSTALLED := $(VENV)/.installed
# What uv is asked for is the version that requirements.txt itself pins.
UV_PIN = $(shell sed -n 's/^\(uv==[^ ;]*\).*/\1/p' requirements.txt)
UV := VIRTUAL_ENV="$(CURDIR)/$(VENV)" $(BIN)/uv
COMPILE = pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest --no-header --no-annotate \
	--no-emit-index-url --no-emit-find-links --all-extras --group dev --group peers --group docs pyproject.toml

# The arrays are small, and pytest runs one process a core: threads inside BLAS would only get in each other's way.
test slow kill pages docs: export OPENBLAS_NUM_THREADS ?= 1
test slow kill pages docs: export OMP_NUM_THREADS ?= 1
test slow kill pages docs: export MKL_NUM_THREADS ?= 1

# Tests, pages and tools start some hundred processes: each would compile every package anew where bytecode is not kept.
# It is kept out of the tree.
export PYTHONDONTWRITEBYTECODE :=
export PYTHONPYCACHEPREFIX := $(CURDIR)/$(VENV)/bytecode

.DEFAULT_GOAL := help
.PHONY: help install demo test slow kill pages bench paper peers order adversary turbine drawn structure methods frozen edge monitoring slopes readers surveyed simulators fuzz platform lint format docs requirements upgrade clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 22

demo: $(INSTALLED) ## simulate a rotor, identify it, compare with the truth (into demo/)
	$(BIN)/floquid demo jeffcott --out demo

test: $(INSTALLED) ## run the tests
	$(PYTEST) $(PARALLEL) $(if $(MARKS),-m "$(MARKS)")

slow: $(INSTALLED) ## run the slow tests, look further for what breaks a law, and measure docs/validation/ again
	$(PYTEST) $(PARALLEL) -m slow
	$(PYTEST) $(PARALLEL) tests/laws --hypothesis-profile=explore

kill: $(INSTALLED) ## kill and interrupt programs at work: what they leave behind is whole
	$(PYTEST) $(PARALLEL) -m kill

pages: $(INSTALLED) ## make the report and open it in a browser, and run every block of every page
	$(PYTEST) $(PARALLEL) -m "pages and not slow"

bench: $(INSTALLED) ## time the benchmarks
	$(PYTEST) benchmarks --benchmark-enable --benchmark-only

paper: $(INSTALLED) ## the paper's figures and numbers beside ours (into build/paper/; two minutes)
	$(BIN)/python -m benchmarks.paper --out build/paper

order: $(INSTALLED) ## how often the order is right, over random systems (into build/order/; ten minutes on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.order --jobs 2 --out build/order

adversary: $(INSTALLED) ## 980 records that try to make it wrong (into build/adversary.json; forty minutes on two cores)
	mkdir -p build
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.adversary --jobs 2 --out build/adversary.json

turbine: $(INSTALLED) ## a turbine-like system from its outputs alone, 100 draws (into build/turbine.json; twenty minutes on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.turbine --draws 100 --jobs 2 --out build/turbine.json

drawn: $(INSTALLED) ## systems drawn at random, 100 with measured inputs and 50 of outputs alone (into build/; forty minutes on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.drawn inputs --draws 100 --jobs 2 --out build/drawn_inputs.json
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.drawn ambient --draws 50 --jobs 2 --out build/drawn_ambient.json

structure: $(INSTALLED) ## A(t) with the structure that is found, over random mechanisms (three minutes on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.structure --jobs 2

peers: $(INSTALLED) ## our identifiers beside other people's (into docs/peers/; a quarter of an hour)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.peers --out docs/peers

methods: $(INSTALLED) ## methods of the literature beside ours (into docs/methods/; a quarter of an hour)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.methods --out docs/methods

edge: $(INSTALLED) ## exponents across the edges of locks, free and with measured inputs (into build/; seven minutes on two cores)
	mkdir -p build
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.edge --jobs 2 --out build/edge.json
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.edge --records inputs --jobs 2 --out build/edge_inputs.json

monitoring: $(INSTALLED) ## false alarms, detection, intervals and time of monitoring (a quarter of an hour)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.monitoring

slopes: $(INSTALLED) ## time and memory against each size of a record, for each kind (into build/slopes/; ten minutes)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.slopes

readers: $(INSTALLED) ## time and memory of every reader on a file of 100 MB (ten minutes)
	$(BIN)/python -m benchmarks.readers

surveyed: $(INSTALLED) ## surveys of turbines of three blades, equal and not, and of two (free decays in six minutes; outputs alone in an hour)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.surveyed

simulators: $(INSTALLED) ## free responses of simulated machines, ten draws each at 1 and 0.1 % noise (into build/simulators.json; half an hour on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.simulators --jobs 2 --out build/simulators.json

frozen: $(INSTALLED) ## decisions on records of all kinds, compared with those kept in benchmarks/frozen/ (four minutes on two cores)
	OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m benchmarks.frozen --jobs 2

fuzz: $(INSTALLED) ## a minute of fuzzing for each reader (what it finds goes to build/fuzz/)
	$(BIN)/python -m tests.fuzz --seconds 60 --findings build/fuzz

platform: $(INSTALLED) ## the package as users install it: without extras, each Python here, the lowest versions allowed
	.ci/platform full

lint: $(INSTALLED) ## style, import contracts and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports --no-cache
	$(BIN)/pyrefly check --summary=none

format: $(INSTALLED) ## put the code into the common form
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

docs: $(INSTALLED) ## build the site into docs/_build/html, warnings being errors
	$(BIN)/sphinx-build -q -j auto -b html -n -W --keep-going -d docs/_build/doctrees $(SPHINX) docs docs/_build/html

install: $(INSTALLED) ## make .venv with everything in it, and nothing else

requirements: $(INSTALLED) ## pin again what pyproject.toml asks for, keeping pinned versions that still do
	$(UV) $(COMPILE) --output-file requirements.txt

upgrade: $(INSTALLED) ## pin the newest versions
	$(UV) $(COMPILE) --upgrade --output-file requirements.txt

clean: ## remove everything that make has made
	rm -rf $(VENV) docs/_build demo build dist .pytest_cache .ruff_cache .hypothesis .benchmarks .import_linter_cache
	find src tests docs -name __pycache__ -type d -prune -exec rm -rf {} +

$(INSTALLED): requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "floquid needs Python 3.11 or newer, and «$(PYTHON)» is: $$($(PYTHON) --version 2>&1)." >&2; \
		echo "  Name another one: make PYTHON=/path/to/python3.11 $(MAKECMDGOALS)" >&2; exit 1; }
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "$(UV_PIN)"
	$(UV) pip sync --quiet requirements.txt
	$(UV) pip install --quiet --no-deps --no-build-isolation --editable .
	@touch $@
