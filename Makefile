# Everything sets itself up: Python 3.11 or newer, git and make are all that is needed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
JAVASCRIPT := tests/javascript
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt
PYTEST := $(BIN)/python -m pytest -n 2 --dist loadfile

.PHONY: demo serve studies test test-real test-hostile headline coverage lint lint-pages pretrain web-check docs clean

demo: $(VENV)/.installed $(VENV)/.kernels
	rm -rf demo
	$(BIN)/elfslam demo demo

serve: $(VENV)/.installed-serve $(VENV)/.kernels
	$(BIN)/elfslam serve

# What `python -m studies NAME` and training need beside the package: PyTorch above all, 1 GB.
studies: $(VENV)/.installed-studies $(VENV)/.kernels
	@$(BIN)/python -m studies --help

# Whatever waits on no clock: the same answer on a machine with other work on it.
test: lint $(VENV)/.kernels
	$(PYTEST) -m "not real" $(LEAVING_OUT)

# Browser, sound server, databases, Ray, kills, small studies, some damaged input of each kind.
test-real: $(VENV)/.installed-test $(VENV)/.kernels
	HOSTILE_CASES=$${HOSTILE_CASES:-40} $(PYTEST) -m real --once-more

# Damaged files, requests and databases by the thousand: an hour.
test-hostile: $(VENV)/.installed-test $(VENV)/.kernels
	HOSTILE_CASES=$${HOSTILE_CASES:-2000} $(PYTEST) -m hostile

# The README's figures in small, against limits.
headline: $(VENV)/.installed-test $(VENV)/.kernels
	$(BIN)/python -m studies.headline

# How much of the pipeline its own tests reach.
coverage: $(VENV)/.installed-test $(VENV)/.kernels
	$(PYTEST) -m "not hostile" tests/base tests/stages tests/slam \
		--cov --cov-report=term:skip-covered --cov-report=json:$(VENV)/coverage.json
	$(BIN)/python tests/coverage_gate.py $(VENV)/coverage.json

lint: $(VENV)/.installed-test lint-pages
	$(BIN)/ruff check src studies tests examples
	$(BIN)/ruff format --check src studies tests examples
	$(BIN)/mypy

# The pages' JavaScript, with tools from npm; a machine without them does without.
lint-pages:
	@if ! command -v npm >/dev/null; then \
		echo "npm is missing: the pages' JavaScript is not linted (Debian: apt-get install npm)"; \
	elif $(MAKE) --no-print-directory $(JAVASCRIPT)/node_modules/.installed; then \
		npm --prefix $(JAVASCRIPT) run --silent lint; \
	else \
		echo "npm cannot install its tools: the pages' JavaScript is not linted"; \
	fi

$(JAVASCRIPT)/node_modules/.installed: $(JAVASCRIPT)/package.json $(JAVASCRIPT)/package-lock.json
	npm --prefix $(JAVASCRIPT) ci --silent
	touch $@

pretrain: $(VENV)/.installed-test $(VENV)/.kernels
	$(BIN)/elfslam pretrain src/elfslam/weights/compact.onnx --seed 0 --force

# Needs node and npm, 20 or newer; no test does.
web-check: $(VENV)/.installed $(VENV)/.kernels
	cd studies/benchmarks/web_runtime && npm ci
	$(BIN)/python -m studies.benchmarks.web_runtime.compare

# An extra brings what it names in pyproject.toml.
$(VENV)/.installed: pyproject.toml constraints.txt
	@echo "Once only: installing elfslam into $(VENV), a minute or two without a word."
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable .
	touch $@

$(VENV)/.installed-serve: $(VENV)/.installed
	$(INSTALL) --editable ".[serve,images,parquet]"
	touch $@

$(VENV)/.installed-studies: $(VENV)/.installed
	$(INSTALL) --editable ".[learn,studies,acoustics,speech,scale,buildings]"
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(INSTALL) --editable ".[learn,test]"
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(INSTALL) --editable ".[docs]"
	touch $@

# A compiled kernel knows when its own file changes, but not when one that it calls does.
$(VENV)/.kernels: $(wildcard src/elfslam/world/*.py)
	find src -name '*.nb[ic]' -delete
	mkdir -p $(VENV) && touch $@

# The site in site/, and docs/reference/tree.md for it: the only page that is not committed.
docs: $(VENV)/.installed-docs
	$(BIN)/python -m studies.tree
	NO_MKDOCS_2_WARNING=true $(BIN)/python -m mkdocs build --strict

clean:
	rm -rf $(VENV) demo site
