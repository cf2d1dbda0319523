# `make demo` and `make test` set up what they need; `make setup` makes the environment alone.
PYTHON ?= python3
# cpu, auto (the build for this machine's driver) or a name such as cu128: see README, "Install".
TORCH_BACKEND ?= cpu

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# A machine that keeps wheels in a folder (PIP_FIND_LINKS) is asked there for torch; else uv picks the build.
ifdef PIP_FIND_LINKS
TORCH_SOURCE := --find-links $(PIP_FIND_LINKS)
else
TORCH_SOURCE := --torch-backend $(TORCH_BACKEND)
endif

export MLFLOW_DISABLE_TELEMETRY := true
export RAY_USAGE_STATS_ENABLED := 0
# Dozens of processes import the same files: the first compiles them, whatever the shell asks for.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: setup demo dashboard test test-long test-newest lint wheel references docs clean

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@echo "setup, 1 of 3: an environment in $(VENV)"
	$(PYTHON) -m venv $(VENV)
	@echo "setup, 2 of 3: uv, which installs packages"
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt uv
	@echo "setup, 3 of 3: the packages of constraints.txt: 4.2 GB, a minute or more"
	$(BIN)/uv pip install --quiet --python $(BIN)/python --constraint constraints.txt \
		--compile-bytecode $(TORCH_SOURCE) --editable ".[all,dev]"
	touch $(STAMP)

demo: setup
	$(BIN)/lidarplace run examples/demo.yaml
	@echo "Next, where four LiDARs go on the roof itself: $(BIN)/lidarplace search examples/search_demo.yaml"

# MLflow on this machine alone; RUN: a sweep's folder, a database, or a tracking URI.
RUN ?= runs/mlflow.db
dashboard: setup
	$(BIN)/lidarplace dashboard "$(RUN)"

test: setup
	$(BIN)/python -m pytest -n 3 --dist worksteal

# The expensive tests that repeat what others show with more cases: for a nightly run.
test-long: setup
	$(BIN)/python -m pytest -n 2 --dist worksteal -m long

# The tests with the newest versions of all dependencies instead of those of constraints.txt, for any Python:
# `make test-newest PYTHON=python3.13`. Its environment, of 4.2 GB, is made anew each time.
NEWEST := build/newest
test-newest:
	rm -rf $(NEWEST)
	$(PYTHON) -m venv $(NEWEST)
	$(NEWEST)/bin/pip install --quiet --disable-pip-version-check uv
	$(NEWEST)/bin/uv pip install --quiet --python $(NEWEST)/bin/python --compile-bytecode \
		$(TORCH_SOURCE) --editable ".[all,dev]"
	$(NEWEST)/bin/python -m pytest -n 3 --dist worksteal

lint: setup
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# The installed package in an environment of its own, outside of this folder.
wheel: setup
	.ci/wheel

# Pages that are made from the code.
references: setup
	$(BIN)/python docs/configuration.py
	$(BIN)/python docs/api.py
	$(BIN)/python docs/commands.py
	$(BIN)/python -m docs.architecture
	$(BIN)/python docs/run_folder.py
	$(BIN)/python docs/sensors.py

# The site, in build/site: docs/, the notebooks (they run: half a minute), the pages of the demo, docstrings in python/.
docs: references demo
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	$(BIN)/pdoc --docformat google --output-directory build/site/python lidarplace training tracking sweeps
	@echo "The site: build/site/index.html"

clean:
	rm -rf $(VENV) build
