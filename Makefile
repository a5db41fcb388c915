# For a fresh machine: `make demo` renders the first picture, `make test` runs the tests, `make docs` builds the pages.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

demo: $(VENV)/.demo
	@mkdir -p out
	$(BIN)/rptcam render examples/first_light.yaml -o out/first_light.png
	@echo "The picture is $(CURDIR)/out/first_light.png"
	@echo "Next: . $(BIN)/activate, then docs/tutorial.md"

test: $(VENV)/.test browser
	$(BIN)/python -m pytest -q

# The tests with the least versions of all packages that pyproject.toml allows, in an environment of their own.
least:
	$(PYTHON) -m venv .venv-least
	.venv-least/bin/python -m pip install --quiet --disable-pip-version-check $$($(PYTHON) -m tests.support.least) --editable '.[pocl,test]'
	.venv-least/bin/python -m pytest -q

# The tests of pages need the system's Chromium. As root on Debian it is installed; elsewhere they are skipped, as the end of the run says.
browser:
	@for each in chromium chromium-browser google-chrome; do command -v $$each >/dev/null && exit 0; done; \
	if [ "$$(id -u)" = 0 ] && grep -qs '^ID=debian' /etc/os-release; then \
		echo "Installing Chromium for the tests of pages"; \
		(apt-get -qq update && DEBIAN_FRONTEND=noninteractive timeout 300 apt-get -qq install -y --no-install-recommends chromium) >/dev/null 2>&1 && exit 0; \
	fi; \
	echo "No Chromium: the tests of pages are skipped (apt-get install chromium)"

# Not --quiet: with it mkdocs does not count the warnings that `strict` is about.
docs: $(VENV)/.docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build
	@echo "The documentation is $(CURDIR)/out/docs/index.html"

lint: $(VENV)/.lint
	$(BIN)/ruff check .
	$(BIN)/mypy

# Plants random faults in a room and says which its tests find: make mutants ROOM=optics COUNT=30 SEED=2
COUNT ?= 20
SEED ?= 1
mutants: $(VENV)/.test
	$(BIN)/python -m tests.support.plant $(ROOM) --count $(COUNT) --seed $(SEED)

# Compilers for GPUs, for `python -m benchmarks.gpu_compilers`: about 800 MB, into a folder of the checkout.
gpu-tools: $(VENV)/.test
	$(BIN)/python -m benchmarks.gpu_tools

# Each stamp says which extras the environment has; a change of pyproject.toml brings it up to date.
$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.demo: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[pocl]'
	@touch $@

$(VENV)/.test: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[pocl,test]'
	@touch $@ $(VENV)/.demo

$(VENV)/.docs: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

$(VENV)/.lint: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[pocl,dev]'
	@touch $@ $(VENV)/.demo $(VENV)/.test

# The extension for Blender, with wheels for each platform that has them
blender: $(VENV)/.demo
	$(BIN)/python -m integrations.blender.build

size: $(VENV)/.test
	$(BIN)/python -m benchmarks.size

clean:
	rm -rf $(VENV) out

.PHONY: demo test least browser docs lint blender size mutants gpu-tools clean
