# `make demo` and `make test` do all the set-up: a virtual environment from pyproject.toml, created again when that changes.
PYTHON ?= python3
VENV ?= .venv
EXTRAS ?= ros,viz,bench,sweep,optimise,animate,gym,play,docs,test
DEMO_EXTRAS := ros,viz
BIN := $(VENV)/bin
MADE := $(VENV)/.made
READY := $(VENV)/.ready
TRIAL := $(or $(TMPDIR),/tmp)/crawler-dist
# the demonstration needs less, but uses the full environment if it exists
READY_DEMO := $(if $(wildcard $(READY)),$(READY),$(VENV)/.ready-demo)
# an environment without the mark was made by somebody else, and may hold what nobody can install again
foreign = $(if $(wildcard $(MADE)),,$(wildcard $(VENV)))
# uv installs in a tenth of pip's time; where it cannot, as from an index that is known to pip alone, pip does
pip := $(BIN)/python -m pip --quiet --disable-pip-version-check
install = { [ -x $(BIN)/uv ] && $(BIN)/uv pip install --quiet --python $(BIN)/python $(1); } || $(pip) install --no-compile $(1)

# Tests start a thousand processes: without bytecode files each of them would compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE

# For coverage the kernels are interpreted, so that their branches are seen; tests that would then take hours are left out.
.PHONY: demo test test-all smoke lint coverage measure-coverage bench docs figures dist mutants soak clean

demo: $(READY_DEMO)
	$(BIN)/crawler demo

# Two workers per core, but no more than six: most tests wait for other processes.
WORKERS ?= $(shell n=$$((2 * $$(nproc))); echo $$((n < 6 ? n : 6)))
PYTEST := $(BIN)/python -m pytest -n $(WORKERS)

# Workers that compile wait for each other's kernels; `crawler warm` divides them among the cores.
test: $(VENV)/.collected
	$(BIN)/crawler warm
	$(PYTEST) -m "not slow"

# once for each environment: all workers at once would compile the bytecode of the tests and of all that they import
$(VENV)/.collected: $(READY)
	@$(BIN)/python -m pytest --collect-only -qq > /dev/null || true
	@touch $@

# and with kernels that check the indices of all that they read and write
test-all: test
	$(PYTEST) -m slow
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(abspath $(VENV))/checked $(PYTEST) -m "not slow" tests/instrument/model tests/lab

# chains on a line with linear springs: to compile the kernels of all others takes minutes for each version of Python
smoke: $(READY)
	$(BIN)/python -m pytest -q -p no:cacheprovider -k "(strategies or messages or lock_step) and not (gallery or swells or remembers)" tests/instrument/model/test_closed_forms.py tests/instrument/ros/test_messages.py tests/instrument/ros/test_lock_step.py

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy

# in an environment of its own, because numba imports coverage wherever it is installed
coverage:
	$(MAKE) measure-coverage VENV=.venv-coverage EXTRAS=$(EXTRAS),coverage

measure-coverage: $(READY)
	NUMBA_DISABLE_JIT=1 $(PYTEST) -q -p no:cacheprovider --cov --cov-report= tests/instrument/model tests/lab --ignore tests/lab/gym --ignore tests/lab/play --ignore tests/lab/pictures
	$(BIN)/coverage report

bench: $(READY)
	for what in methods calls growth node replay identify mistakes many; do $(BIN)/python -m benchmarks $$what --out benchmarks/results || exit 1; done

docs: $(READY)
	$(BIN)/python docs/generate.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open site/index.html"

figures: $(READY)
	$(BIN)/python docs/bodies.py
	$(BIN)/python docs/hard_cases.py
	$(BIN)/python docs/laboratory.py
	$(BIN)/python docs/loads.py
	$(BIN)/python docs/motors.py
	$(BIN)/python docs/phase_diagram.py
	$(BIN)/python docs/play.py
	$(BIN)/python docs/rerun.py
	$(BIN)/crawler animate three_contacts_two_ways --out docs/pictures/crawl.gif --fps 12 --duration 4 --force
	for scene in three_link_snake steering_inchworm; do $(BIN)/crawler animate $$scene --talk --out docs/pictures/$$scene.mp4 --fps 15 --duration 4 --force; done
	$(BIN)/python docs/tutorial.py
	$(BIN)/python docs/validation.py

# the wheel is tried where nothing of this folder can be imported; what follows `crawler demo` is what a user does first
dist: $(READY)
	rm -rf dist
	$(call install,build)
	$(BIN)/python -m build --installer uv
	rm -rf $(TRIAL) && $(BIN)/python -m venv $(TRIAL)
	$(BIN)/uv pip install --quiet --python $(TRIAL)/bin/python "$$(echo dist/*.whl)[ros,viz,gym]" || $(TRIAL)/bin/pip install --quiet "$$(echo dist/*.whl)[ros,viz,gym]"
	cd $(TRIAL) && bin/crawler demo && bin/crawler simulate two_anchor_a --json && bin/crawler check two_anchor_a && bin/crawler replay demo
	rm -rf $(TRIAL)

# one at a time, in copies of the tree: for developers, who judge what survives
mutants: $(READY)
	$(BIN)/python -m tests.mutants --count $(or $(N),60) --seed $(or $(SEED),0)

soak: $(READY)
	HYPOTHESIS_PROFILE=soak $(BIN)/python -m pytest tests/instrument/model tests/instrument/replay/test_slips.py --timeout=7200
	CRAWLER_SOAK=1 $(BIN)/python -m pytest tests/instrument/ros/test_load.py tests/instrument/ros/test_faults.py tests/instrument/ros/test_security.py \
		tests/instrument/replay/test_hostile_files.py tests/system/test_identify.py --timeout=7200

$(MADE): pyproject.toml
	$(if $(foreign),$(error $(VENV) was not made by this Makefile and is left alone: choose another folder, as make demo VENV=.venv-crawler, or install into yours: pip install -e '.[all]'))
	@$(PYTHON) -c 'import sys; sys.exit("crawler needs Python >= 3.10, $(PYTHON) is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	$(PYTHON) -m venv --clear $(VENV)
	touch $(MADE)
	@echo 'installing what pyproject.toml names, without further output'
	@$(pip) install 'uv>=0.8,<1' || echo 'without uv, which pip does not find, this takes some minutes'

# colcon brings coverage, which numba imports wherever it is installed: a twentieth of a second in each of those processes
$(READY): $(MADE)
	$(call install,-e '.[$(EXTRAS)]')
	$(if $(findstring coverage,$(EXTRAS)),,$(pip) uninstall --yes coverage pytest-cov)
	touch $(READY)

# the kernels of chains, which the demonstration needs: those of other bodies compile when they are first used
$(VENV)/.ready-demo: $(MADE)
	$(call install,-e '.[$(DEMO_EXTRAS)]')
	$(BIN)/crawler warm line
	touch $@

clean:
	$(if $(foreign),$(info $(VENV) was not made by this Makefile and is left alone))
	rm -rf $(if $(foreign),,$(VENV)) $(patsubst %/.made,%,$(wildcard .venv-*/.made)) build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
