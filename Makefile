# Three commands on a new machine with Rust and Python >= 3.10; all that they install are the versions in Cargo.lock and
# requirements-dev.lock:
#   make demo   set up, build, refine the embedded real sample into ./skelsplat-demo
#   make test   set up, every check; `make test-all` tries more cases of each
#   make docs   set up, build the documentation into ./site
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMPS := .stamps

RUST_SOURCES   := Cargo.toml Cargo.lock $(shell find crates -name '*.rs' -o -name 'Cargo.toml' 2>/dev/null)
PYTHON_SOURCES := pyproject.toml README.md $(shell find python -name '*.py' -o -name '*.pyi' -o -name '*.zip' -o -name '*.html' -o -name '*.css' -o -name '*.js' 2>/dev/null)

# uv installs in a tenth of pip's time; pip does where uv cannot, as from an index that only pip is told of.
install = $(BIN)/uv pip install --quiet --python $(BIN)/python $(1) || $(BIN)/python -m pip install --quiet $(1)
LOCKED := --constraint requirements-dev.lock
WHEEL = $$(ls dist/*.whl)
DEV := all,dev
# uv leaves libraries uncompiled; these are read in a process whose seconds count (io/_guarded_child.py).
TIMED := ezc3d h5netcdf h5py pandas scipy/io tables xarray
COMPILE := $(BIN)/python -m compileall -q -x /tests/ $(TIMED:%=$(VENV)/lib/python3*/site-packages/%)
# What a process has compiled the next one reads, also where the environment says otherwise, as images of containers do.
unexport PYTHONDONTWRITEBYTECODE

# One more than there are cores, since tests wait for browsers and other programs; more than a few gain nothing.
WORKERS = $(shell $(PYTHON) -c 'import os; print(min(8, (os.cpu_count() or 1) + 1))')
PYTEST = $(BIN)/python -m pytest --numprocesses $(WORKERS) --dist worksteal $(MARKS)

.PHONY: demo test test-all machine fuzz fuzz-case docs fmt lint rust-lint sources-lint python-lint rust-test python-check \
        python-test bench clean wheel sdist lock test-lowest package reproducible notices deny publish-check

demo: $(STAMPS)/installed
	$(BIN)/skelsplat demo -o skelsplat-demo
	@echo "To look at it in the browser, and to use your own recordings there: $(BIN)/skelsplat app skelsplat-demo"

# In this order on two cores: while the wheel is built, for which the rest waits, sources are checked and libraries installed
# on what it leaves; then pytest and the Rust tests run at the same time.
test-all: export MARKS = -m ''
test-all: export CHECKED = cargo test --locked --quiet
test-all lint: export CRATES = --workspace
test test-all:
	$(MAKE) --jobs 2 rust-lint $(STAMPS)/wheel python-check rust-test

# Random inputs for so many minutes each to Python and Rust; findings are saved and printed with how to repeat them.
# CONTRIBUTING.md says what it tries.
MINUTES ?= 10
FUZZ := PYTHONPATH=tests:tools:benchmarks $(BIN)/python -m fuzz
fuzz: $(STAMPS)/dev
	$(FUZZ) --minutes $(MINUTES)
	PROPTEST_CASES=$$((200 * $(MINUTES))) cargo test --release --locked -p skelsplat-tests --test suite fuzz::

fuzz-case: $(STAMPS)/dev
	$(FUZZ) $(CASE)

machine:
	@$(PYTHON) -c 'import sys; sys.exit("Python >= 3.10 is needed, this is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	@command -v cargo >/dev/null || { echo "cargo is needed: install Rust >= 1.89 (https://rustup.rs)" >&2; exit 1; }

# Its own interpreter: nothing is installed outside this folder.
$(STAMPS)/venv: pyproject.toml requirements-dev.lock | machine
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check 'uv>=0.9,<1'
	$(call install,$(LOCKED) maturin)
	@mkdir -p $(STAMPS) && touch $@

# The wheel that users get, built and installed with the extras that its commands need; not an editable checkout.
$(STAMPS)/wheel: $(STAMPS)/venv $(RUST_SOURCES) $(PYTHON_SOURCES)
	rm -rf dist && rm -f python/skelsplat/_skelsplat*.so
	$(MAKE) wheel
	@touch $@

$(STAMPS)/installed: $(STAMPS)/wheel
	$(call install,--force-reinstall --no-deps $(WHEEL))
	$(call install,$(LOCKED) "$(WHEEL)[all]")
	$(COMPILE)
	@touch $@

$(STAMPS)/libraries: $(STAMPS)/venv
	$(call install,--requirement requirements-dev.lock)
	$(COMPILE)
	@touch $@

$(STAMPS)/dev: $(STAMPS)/wheel $(STAMPS)/libraries
	$(call install,--force-reinstall --no-deps $(WHEEL))
	$(call install,$(LOCKED) "$(WHEEL)[$(DEV)]")
	@touch $@

# No path of this machine is in the wheel, so the same commit gives the same bytes in any folder.
REMAP := --remap-path-prefix=$(CURDIR)=. --remap-path-prefix=$${CARGO_HOME:-$$HOME/.cargo}=cargo
WITH_FLAGS := RUSTFLAGS="$$RUSTFLAGS $(REMAP)"
# With these the Rust tests take over what the wheel's build has compiled.
AS_WHEEL := --release --locked --quiet --features pyo3/extension-module
wheel:
	$(WITH_FLAGS) $(BIN)/maturin build --release --locked --quiet --interpreter $(BIN)/python --out dist
sdist:
	$(BIN)/maturin sdist --out dist

fmt:
	cargo fmt --all
	$(BIN)/ruff format . && $(BIN)/ruff check --fix .

lint: rust-lint python-lint

# In a folder of cargo's that the wheel's build does not lock.
rust-lint: | machine
	nice cargo fmt --all --check
	nice cargo clippy --locked --quiet $(CRATES) --all-targets -- -D warnings
	RUSTDOCFLAGS="-D warnings" nice cargo doc --locked --quiet --no-deps

sources-lint: $(STAMPS)/libraries
	nice $(BIN)/ruff format --check .
	nice $(BIN)/ruff check .
	nice $(BIN)/mypy

python-lint: sources-lint $(STAMPS)/dev
	$(BIN)/python -m mypy.stubtest skelsplat._skelsplat

# The core that is tested is the one in the wheel; `make test-all` tries it with checks for overflow as well.
rust-test: $(STAMPS)/wheel
	$(WITH_FLAGS) cargo test $(AS_WHEEL)
	$(CHECKED)

python-test: $(STAMPS)/dev
	$(PYTEST)

python-check: python-lint
	$(MAKE) python-test

# The site needs no network: open site/index.html.
docs: $(STAMPS)/dev
	$(BIN)/sphinx-build -W -n --keep-going -q docs site

# The newest versions that pyproject.toml admits, for all platforms and Python 3.10 to 3.14.
lock: $(STAMPS)/venv
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.10 --extra all --extra dev --no-annotate \
	    --custom-compile-command 'make lock' --output-file requirements-dev.lock pyproject.toml

# The oldest versions that pyproject.toml admits; old libraries warn of each other.
LOWEST := $(VENV)-lowest/bin/python -m pytest --timeout 900 -W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning \
          -W ignore::FutureWarning
test-lowest: $(STAMPS)/installed
	$(BIN)/uv venv --quiet --clear --python $(PYTHON) $(VENV)-lowest
	$(BIN)/uv pip compile --quiet --resolution lowest-direct --python $(VENV)-lowest --extra all --extra dev pyproject.toml \
	    --output-file $(VENV)-lowest/requirements.txt
	$(BIN)/uv pip install --quiet --python $(VENV)-lowest --requirements $(VENV)-lowest/requirements.txt
	$(BIN)/uv pip install --quiet --python $(VENV)-lowest --no-deps dist/*.whl
	$(LOWEST) tests/unit tests/parity

# What is uploaded: wheel and sdist, each installed into an empty environment and used there, the wheel without Rust.
package: $(STAMPS)/installed
	$(MAKE) sdist
	$(BIN)/python tools/check_package.py dist/*.whl
	$(BIN)/python tools/check_package.py dist/*.tar.gz

# The same bytes from two clones of this commit, in two folders.
reproducible: COPIES := $(shell mktemp -d -u)
reproducible: $(STAMPS)/venv
	for copy in one two/deeper; do \
	  git clone --quiet . $(COPIES)/$$copy && $(MAKE) -C $(COPIES)/$$copy BIN=$(abspath $(BIN)) wheel sdist || exit 1; done
	cd $(COPIES) && sha256sum one/dist/* two/deeper/dist/*
	diff -r $(COPIES)/one/dist $(COPIES)/two/deeper/dist
	rm -rf $(COPIES)

# Needs cargo-bundle-licenses and cargo-cyclonedx, from crates.io.
notices:
	cargo bundle-licenses --format yaml --prefer MIT --prefer Zlib --prefer BSD-2-Clause \
	    --previous licenses/third-party.yml --output licenses/third-party.yml
	$(PYTHON) tools/sbom.py

# Needs cargo-deny, from crates.io; advisories need GitHub.
deny:
	cargo deny --locked check

publish-check:
	cargo publish --dry-run --locked --allow-dirty --package skelsplat-core

bench: $(STAMPS)/dev
	$(BIN)/python benchmarks/speed.py paper

clean:
	rm -rf $(VENV) $(VENV)-lowest $(STAMPS) dist target site skelsplat-demo skelsplat-demo-people
