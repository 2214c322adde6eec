# Every target sets up what it needs: a Python >= 3.11 and a network, the first time, are enough.
.DEFAULT_GOAL := help
.PHONY: help run reproduce test test-quick test-all test-python warm warm-more wheel package docs lint bench coverage clean look

# The tests start hundreds of processes: none shall compile Python that another has compiled.
unexport PYTHONDONTWRITEBYTECODE

BIN := .venv/bin
READY := .venv/.ready
PEERS := .venv/.peers
WEB := src/cohelm/station/static/index.html
GL := .venv/.gl
BROWSER := .venv/.browser
FASTDDS := .venv/.fastdds
REWRITTEN := .venv/.rewritten
TYPED := .venv/.typed
LISTED := .venv/.listed
MODULES := $(shell find src benchmarks/bench -name node_modules -prune -o -name '*.py' -print | sort)

help:            ## show these lines
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

run: $(READY) $(WEB) $(GL) ## start a simulated robot and its station, and print the address
	$(BIN)/cohelm drive

reproduce: $(READY) ## run the paper's three experiments and draw its figures
	$(BIN)/cohelm reproduce --out out/reproduce
	@echo "The figures are in out/reproduce (PNG and SVG)."

test: $(READY)   ## lint, then the tests
	@# Three at a time: one of them waits for packages most of the time.
	@$(MAKE) --no-print-directory -j3 --output-sync=target $(WEB) $(GL) $(BROWSER) $(FASTDDS) \
	  warm warm-more lint $(REWRITTEN)
	$(BIN)/pytest -n auto --dist loadgroup $(EXAMPLES)

warm: $(READY)   # compile once what every worker of the tests would compile for itself
	@$(BIN)/python -m tests.warm

warm-more: $(READY) # and the rest of it, beside that
	@$(BIN)/python -m tests.warm more

test-quick: $(READY) ## the tests of law, gate, scenarios and API, in less than a minute
	$(BIN)/pytest -m quick

test-all: EXAMPLES = --hypothesis-profile=more
test-all: test   ## all tests, also those that take long, and all cases of each
	$(BIN)/pytest -m slow $(EXAMPLES)

test-python: $(WEB) $(GL) $(BROWSER) ## the tests on another Python that is here: PYTHON=3.13
	UV_PROJECT_ENVIRONMENT=.venv-$(PYTHON) $(BIN)/uv sync --frozen --quiet --python $(PYTHON) --all-extras --no-extra peers
	.venv-$(PYTHON)/bin/python -m tests.warm
	.venv-$(PYTHON)/bin/python -m tests.warm more
	.venv-$(PYTHON)/bin/pytest -n auto --dist loadgroup

docs: $(READY)   ## build the documentation as a site, and check all its links
	$(BIN)/python tools/docs.py

wheel: $(READY)  ## build the wheel, with pages, robots and scenarios, into dist/
	$(BIN)/uv build --wheel --out-dir dist

package: $(READY) ## build the wheel as from a fresh clone, and try it in an empty environment
	$(BIN)/pytest -m slow tests/e2e/test_wheel.py

lint: $(READY)   ## lock file, style, types, import order
	@# A package mirror set for this machine says nothing about the lock file.
	@env -u UV_DEFAULT_INDEX -u UV_INDEX_URL $(BIN)/uv lock --check --offline --quiet 2>/dev/null || \
	  { echo "uv.lock does not match pyproject.toml; run: $(BIN)/uv lock" >&2; exit 1; }
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	@$(MAKE) --no-print-directory $(TYPED)
	$(BIN)/lint-imports

bench: $(PEERS)  ## time the law and the simulator beside their peers
	$(BIN)/python benchmarks

coverage: $(READY) ## test the law uncompiled, and show the lines no test reaches
	@$(BIN)/uv sync --frozen --quiet --inexact --only-group coverage
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest tests/law --cov=cohelm.law
	@$(BIN)/uv pip uninstall --quiet pytest-cov coverage

clean:           ## remove what make made: environment, figures, caches
	rm -rf .venv .venv-* .uv out/reproduce out/docs out/site dist .coverage .hypothesis .pytest_cache .ruff_cache .import_linter_cache
	find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

$(READY): pyproject.toml uv.lock tools/setup.sh
	tools/setup.sh
	@touch $@

# The longest of all checks: again only when what it reads has changed, a module that is gone too.
$(TYPED): $(READY) $(MODULES) $(LISTED)
	$(BIN)/pyright
	@touch $@

$(LISTED): $(READY) look # newer only where other modules are there
	@printf '%s\n' $(MODULES) | cmp -s - $@ || printf '%s\n' $(MODULES) > $@

$(REWRITTEN): $(READY) # once what every worker would do to all tests' assertions
	@$(BIN)/pytest --collect-only -qq > /dev/null || true
	@touch $@

$(PEERS): $(READY)
	tools/setup.sh peers
	@touch $@

$(WEB): $(READY) $(shell find src/cohelm/station/web -type f -not -path '*/node_modules/*')
	tools/web.sh
	@touch $@

$(GL): $(READY) tools/system.sh # what the twin's camera draws with; without it, it casts rays
	tools/system.sh libegl1 libgl1
	@touch $@

$(BROWSER): $(READY) tools/system.sh | $(GL) # one apt-get at a time: what the tests of the station and of the link need
	tools/system.sh chromium-headless-shell iproute2
	@touch $@

$(FASTDDS): $(READY) tools/system.sh tools/peer.sh tests/ros/peer.cpp | $(BROWSER) # what the tests of ROS 2 need
	tools/peer.sh
	@touch $@
