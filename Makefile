# The two commands of the README: `make run` and `make test`. Everything installs into .venv.
PYTHON  ?= python3
VENV    := .venv
BIN     := $(VENV)/bin
RUNS    ?= runs
WORKERS ?= 2
# One more than there are cores: some tests wait for other processes.
TESTERS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)
LONG    ?=
# Where the tests write: in memory, where there is room; on a disk they wait for it most of their time.
SCRATCH := TMPDIR=$$($(BIN)/python tests/scratch.py)
INSTALL := $(BIN)/python -m pip install --quiet --constraint constraints.txt

# One thread per process: numerical libraries must not reorder sums, nor fight Dask for cores.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# Tests start hundreds of processes: where the environment forbids bytecode, each would compile every module anew.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: help env env-test env-lint run test long wheel lint docs torture damage power-loss mutants readme clean

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/'

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Softclose needs Python 3.11 or later: make PYTHON=/path/to/python3.11 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(BIN)/python pyproject.toml constraints.txt
	@echo 'installing Softclose into $(VENV): up to two minutes the first time'
	$(INSTALL) --editable .
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	@echo 'installing what the tests need into $(VENV): up to two minutes the first time'
	$(INSTALL) --editable '.[test]'
	@touch $@

$(VENV)/.installed-lint: $(VENV)/.installed-test
	@echo 'installing the linters into $(VENV): up to two minutes the first time'
	$(INSTALL) --editable '.[lint]'
	@touch $@

$(VENV)/.installed-mutants: $(VENV)/.installed-test
	@echo 'installing the mutation tester into $(VENV): up to two minutes the first time'
	$(INSTALL) --editable '.[mutants]'
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	@echo 'installing what the site is made with into $(VENV): up to two minutes the first time'
	$(INSTALL) --editable '.[docs]'
	@touch $@

env: $(VENV)/.installed  ## create .venv and install Softclose into it
env-test: $(VENV)/.installed-test
env-lint: $(VENV)/.installed-lint
env-docs: $(VENV)/.installed-docs
env-mutants: $(VENV)/.installed-mutants

run: env  ## the main job: two and three pulses for the current design (RUNS=..., WORKERS=...)
	$(BIN)/softclose run current --store $(RUNS)/current.zarr --workers $(WORKERS)
	$(BIN)/softclose run current-three --store $(RUNS)/current-three.zarr --workers $(WORKERS)
	$(BIN)/softclose compare $(RUNS)/current.zarr $(RUNS)/current-three.zarr

test: env-test  ## a case of every claim, on a process more than there are cores (TESTERS=...)
	PYTHONPATH=tests $(BIN)/python -m compile_kernels
	$(SCRATCH) $(BIN)/python -m pytest --numprocesses $(TESTERS) --dist worksteal

lint: env-lint  ## style, types and the direction of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: env-docs  ## the documentation as a site in docs/_build/html, warnings as errors
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo docs/_build/html/index.html

readme: env  ## the README's picture and table, from the stores of `make run`, certified first (RUNS=...)
	$(BIN)/softclose certify $(RUNS)/current.zarr
	$(BIN)/softclose certify $(RUNS)/current-three.zarr
	$(BIN)/python docs/readme.py $(RUNS)

long: env-test  ## what `make test` leaves out: every case of the claims that take minutes
	SOFTCLOSE_WHOLE=1 PYTHONPATH=tests $(BIN)/python -m compile_kernels
	$(SCRATCH) SOFTCLOSE_WHOLE=1 $(BIN)/python -m pytest -m long --timeout 1800 $(LONG) --numprocesses $(TESTERS) --dist worksteal

wheel: env  ## sdist, and the wheel built from it, installed elsewhere: a small run and its report from an empty folder
	rm -rf build/wheel && mkdir -p build/wheel/empty
	$(PYTHON) -m venv build/wheel/tools
	build/wheel/tools/bin/python -m pip install --quiet build
	build/wheel/tools/bin/python -m build --outdir build/wheel . >build/wheel/build.log
	$(PYTHON) -c 'import glob, tarfile; names = tarfile.open(glob.glob("build/wheel/*.tar.gz")[0]).getnames(); \
	  found = {n.split("/", 1)[-1] for n in names}; \
	  assert {"README.md", "LICENSE", "tests/conftest.py", "pipeline/softclose/presets/current.toml"} <= found'
	$(PYTHON) -m venv build/wheel/venv
	build/wheel/venv/bin/python -m pip install --quiet --constraint constraints.txt build/wheel/*.whl
	cd build/wheel/empty && env -u PYTHONPATH ../venv/bin/softclose run current --store a.zarr --serial --quiet --set campaign.budget=6 \
	  --set optimiser.n_initial=4 --set population.n_switches=50 --set store.n_times=21
	cd build/wheel/empty && env -u PYTHONPATH ../venv/bin/softclose run cantilever --store b.zarr --serial --quiet --set explore.budget=16 \
	  --set explore.n_descents=1 --set explore.n_scouts=8 --set explore.generation=4 --set finish.budget=0 \
	  --set population.n_switches=50 --set opening.brake=0
	cd build/wheel/empty && env -u PYTHONPATH ../venv/bin/softclose report a.zarr -o a.html && test -s a.html
	@echo the wheel runs from an empty folder

torture: env-test  ## 200 kills at random instants, each resumed and compared bit for bit
	PYTHONPATH=tests $(BIN)/python -m torture --rounds 200

damage: env-test  ## 1,000 damages, found and repaired, into docs/measurements/damage.md (a quarter of an hour)
	PYTHONPATH=tests $(BIN)/python -m damage --rounds 1000

power-loss: env-test  ## the power goes after every step of a small campaign, with and without `durable`
	PYTHONPATH=tests $(BIN)/python -m lose_power

mutants: env-mutants  ## how many small changes of meaning the tests notice, into docs/measurements/mutants.md (an hour)
	PYTHONPATH=tests $(BIN)/python -m mutants

clean:  ## remove the environment and the caches; stores stay
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis
