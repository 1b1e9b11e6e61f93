# Everything sets itself up: Python 3.11 or newer, git and make are all that is needed.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

.PHONY: demo serve test test-real fast lint coverage pretrain web-check docs clean

demo: $(VENV)/.installed $(VENV)/.kernels
	rm -rf demo
	$(BIN)/elfslam demo demo

serve: $(VENV)/.installed-serve $(VENV)/.kernels
	$(BIN)/elfslam serve

test: lint $(VENV)/.kernels
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not hostile" --cov --cov-report=term:skip-covered --cov-report=json:$(VENV)/coverage.json
	$(BIN)/python tests/coverage_gate.py $(VENV)/coverage.json

# Damaged files, requests and databases by the thousand; others with --hypothesis-seed=N.
test-real: $(VENV)/.installed-test $(VENV)/.kernels
	HOSTILE_CASES=$${HOSTILE_CASES:-2000} \
		$(BIN)/python -m pytest -n 2 --dist loadfile -m hostile

fast: $(VENV)/.installed-test $(VENV)/.kernels
	$(BIN)/python -m pytest -m "not slow and not hostile"

lint: $(VENV)/.installed-test
	$(BIN)/ruff check src studies tests
	$(BIN)/ruff format --check src studies tests
	$(BIN)/mypy

pretrain: $(VENV)/.installed-test $(VENV)/.kernels
	$(BIN)/elfslam pretrain src/elfslam/weights/compact.onnx --seed 0

# Needs node and npm, 20 or newer; no test does.
web-check: $(VENV)/.installed $(VENV)/.kernels
	cd benchmarks/web_runtime && npm ci
	$(BIN)/python benchmarks/web_runtime/compare.py

$(VENV)/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(INSTALL) --editable .
	touch $@

$(VENV)/.installed-serve: $(VENV)/.installed
	$(INSTALL) --editable ".[serve,learn,images,parquet]"
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

# The site in site/; the page of the tree is made anew beside it.
docs: $(VENV)/.installed-docs
	$(BIN)/python -m studies.tree
	NO_MKDOCS_2_WARNING=true $(BIN)/python -m mkdocs build --strict

clean:
	rm -rf $(VENV) demo site
