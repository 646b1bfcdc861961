# The two commands that matter: 'make demo' and 'make test'. Both need Python 3.11 or newer, and nothing else.

VENV := .venv
BIN := $(VENV)/bin
ONLY ?=
PYTEST_OPTIONS ?=
PYTEST := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.PHONY: demo test studies lint benchmarks docs site clean

demo: $(VENV)/installed
	$(BIN)/rfea demo

test: $(VENV)/installed-dev
	@command -v chromium chromium-browser google-chrome >/dev/null 2>&1 || echo "no Chromium here: the tests that open the report in a browser are skipped"
	$(PYTEST) -m "not study" $(PYTEST_OPTIONS)

# the tests that show at length what shorter ones show in small: some minutes more
studies: $(VENV)/installed-dev
	$(PYTEST) -m study $(PYTEST_OPTIONS)

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/basedpyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

benchmarks: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks $(ONLY)

docs: $(VENV)/installed-dev
	$(BIN)/python docs/generate.py

# the documentation as pages that need no network, in build/site; a gallery of six campaigns with GALLERY=yes
site: $(VENV)/installed-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet
	$(if $(GALLERY),$(BIN)/python docs/gallery.py build/site/gallery)

# --no-build-isolation: the build backend is pinned in requirements.txt like everything else
$(VENV)/installed: requirements.txt pyproject.toml
	@./.ci/python -c 'import sys' || exit 1
	test -x $(BIN)/python || ./.ci/python -m venv $(VENV) || { rm -rf $(VENV); echo "Python's venv module does not work here; on Debian: apt-get install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps --editable .
	@touch $@

# linters, type checker, test tools, what builds the site, and all extras: the demo needs none of them
$(VENV)/installed-dev: $(VENV)/installed requirements-dev.txt requirements-docs.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements-dev.txt --requirement requirements-docs.txt
	@touch $@

clean:
	rm -rf $(VENV) demo build dist
