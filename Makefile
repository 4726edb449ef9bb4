# On a fresh machine with Python 3.11+ and make: `make bench` or `make test`.
PYTHON ?= python3.11
VENV ?= .venv
BIN := $(VENV)/bin

# Pins every package that set-up installs, the build backend included.
export PIP_CONSTRAINT := $(CURDIR)/constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: bench test docs test-lowest test-python313 test-mujoco fuzz check check-page format format-page wheel bench-ci baseline ci-run policies clean

bench: $(VENV)/.run
	$(BIN)/hlsd bench --planner hlsd10

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n auto --dist loadscope --no-loadscope-reorder

# The documentation as a site, build/site/index.html; no network is needed to read it.
docs: $(VENV)/.docs
	$(BIN)/python -m sphinx -q -W --keep-going -j auto -c tools/site . build/site
	@echo "build/site/index.html"

# The declared bounds: the lowest direct dependencies, and Python 3.13, each in an
# environment of its own that uv makes; a part of the tests, as only versions differ.
# Skipped with the reason where uv cannot get the interpreter.
BOUNDS := tests/cli/test_surroundings.py tests/cli/test_options.py \
	tests/core/test_compiled.py tests/core/test_content.py tests/core/test_npz.py \
	tests/core/test_progress.py tests/core/test_registry.py \
	tests/data/test_barn.py tests/report/test_tables.py tests/report/test_escaping.py \
	tests/analysis/test_statistics.py \
	$(foreach name,pursuit dwa lfh04 hlsd10 hlsd20,"tests/planners/test_planner_contract.py::test_a_planner_keeps_the_whole_contract[$(name)]")

test-lowest: $(VENV)/.uv
	PYTHON=$(PYTHON) UV=$(BIN)/uv scripts/test_bounds.sh lowest $(BOUNDS)

test-python313: $(VENV)/.uv
	PYTHON=3.13 UV=$(BIN)/uv scripts/test_bounds.sh pinned $(BOUNDS)

# What `hlsd worlds export` writes, in MuJoCo 3.5 and 4.0 and mujoco-warp of both.
test-mujoco: $(VENV)/.run $(VENV)/.uv
	PYTHON=$(PYTHON) HLSD=$(BIN)/hlsd UV=$(BIN)/uv scripts/test_mujoco.sh

# 10 000 damaged files for every reader; the tests take 200.
fuzz: $(VENV)/.dev
	HLSD_FUZZ=10000 $(BIN)/python -m pytest -n auto tests/project/test_fuzz.py

check: $(VENV)/.dev check-page
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# The report page's scripts: prettier and eslint, where npm can install them.
PAGE_TOOLS := tools/page/node_modules/.package-lock.json

ifneq ($(shell command -v npm),)
check-page: $(PAGE_TOOLS)
	npm --silent --prefix tools/page run check
else
check-page:
	@echo "npm is not there: the page's scripts are not checked"
endif

$(PAGE_TOOLS): tools/page/package-lock.json
	npm --silent --prefix tools/page ci --no-audit --no-fund
	touch $@

format: $(VENV)/.dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .
	$(if $(shell command -v npm),$(MAKE) format-page)

format-page: $(PAGE_TOOLS)
	npm --silent --prefix tools/page run format

wheel: $(VENV)/.dev
	$(BIN)/python -m build --wheel

# Continuous integration: 24 worlds, held against the committed baseline.
CI_WORLDS := 0:300:13
CI_RUN := build/bench-ci

bench-ci: ci-run
	$(BIN)/hlsd gate $(CI_RUN) --baseline baselines/hlsd10.json

# Make the baseline again, after a change that is meant to change results.
baseline: ci-run
	rm -f baselines/hlsd10.json
	$(BIN)/hlsd baseline $(CI_RUN) --out baselines/hlsd10.json

ci-run: $(VENV)/.run
	rm -rf $(CI_RUN)
	$(BIN)/hlsd bench --planner hlsd10 --worlds $(CI_WORLDS) --trials 2 --out $(CI_RUN)

# Make the shipped policies again from the recorded commands.
policies: $(VENV)/.dev
	$(BIN)/python scripts/make_policies.py

clean:
	rm -rf $(VENV) build dist

$(VENV)/.venv:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.uv: $(VENV)/.venv constraints.txt
	$(BIN)/python -m pip install --quiet uv
	touch $@

$(VENV)/.run: $(VENV)/.venv constraints.txt pyproject.toml
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.docs: $(VENV)/.run
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

$(VENV)/.dev: $(VENV)/.venv constraints.txt pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[train,checkpoints,dynabarn,ray,video,onnx,gym,dev]'
	touch $@ $(VENV)/.run
