# Three commands on a new machine with Rust and Python >= 3.10:
#   make demo   set up, build, refine the embedded real sample into ./skelsplat-demo
#   make test   set up, every check; `make test-all` tries more cases of each
#   make docs   set up, build the documentation into ./site
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMPS := .stamps

RUST_SOURCES   := Cargo.toml Cargo.lock $(shell find crates -name '*.rs' -o -name 'Cargo.toml' 2>/dev/null)
PYTHON_SOURCES := pyproject.toml README.md $(shell find python -name '*.py' -o -name '*.pyi' -o -name '*.zip' -o -name '*.html' -o -name '*.css' -o -name '*.js' 2>/dev/null)

# As many as there are cores; more than a few gain nothing.
PYTEST := $(BIN)/python -m pytest --numprocesses auto --maxprocesses 8 --dist worksteal

.PHONY: demo test test-all fuzz fuzz-case docs fmt lint rust-lint python-lint rust-check rust-test python-test bench clean

demo: $(STAMPS)/installed
	$(BIN)/skelsplat demo -o skelsplat-demo

# The compiler and mypy have a core each; pytest takes all of them.
test-all: PYTEST += -m ''
test test-all: $(STAMPS)/dev
	$(MAKE) --jobs 2 rust-check python-lint
	$(PYTEST)

# Random inputs for so many minutes; findings are saved and printed with how to repeat them.
# docs/reliability.md, "Fuzzing", says what it tries.
MINUTES ?= 10
FUZZ := PYTHONPATH=tests:tools:benchmarks $(BIN)/python -m fuzz
fuzz: $(STAMPS)/dev
	$(FUZZ) --minutes $(MINUTES)

fuzz-case: $(STAMPS)/dev
	$(FUZZ) $(CASE)

# Its own interpreter: nothing is installed outside this folder.
$(STAMPS)/venv: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Python >= 3.10 is needed, this is " + sys.version.split()[0] if sys.version_info < (3, 10) else 0)'
	@command -v cargo >/dev/null || { echo "cargo is needed: install Rust >= 1.89 (https://rustup.rs)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet 'maturin>=1.9,<2'
	@mkdir -p $(STAMPS) && touch $@

# The wheel that users get, built and installed with the extras that its commands need; not an editable checkout.
$(STAMPS)/installed: $(STAMPS)/venv $(RUST_SOURCES) $(PYTHON_SOURCES)
	rm -rf dist && rm -f python/skelsplat/_skelsplat*.so
	$(BIN)/maturin build --release --quiet --interpreter $(BIN)/python --out dist
	$(BIN)/python -m pip install --quiet --force-reinstall --no-deps dist/*.whl
	$(BIN)/python -m pip install --quiet "$$(ls dist/*.whl)[all]"
	@touch $@

$(STAMPS)/dev: $(STAMPS)/installed
	$(BIN)/python -m pip install --quiet "$$(ls dist/*.whl)[dev]"
	@touch $@

fmt:
	cargo fmt --all
	$(BIN)/ruff format . && $(BIN)/ruff check --fix .

lint: rust-lint python-lint

rust-lint:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --quiet -- -D warnings

python-lint: $(STAMPS)/dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest skelsplat._skelsplat

rust-test:
	cargo test --workspace --quiet
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --quiet

# One after the other: cargo locks its folder.
rust-check: rust-lint
	$(MAKE) rust-test

python-test: $(STAMPS)/dev
	$(PYTEST)

# The site needs no network: open site/index.html.
docs: $(STAMPS)/dev
	$(BIN)/sphinx-build -W -n --keep-going -q docs site

bench: $(STAMPS)/dev
	$(BIN)/python benchmarks/paper.py

clean:
	rm -rf $(VENV) $(STAMPS) dist target site skelsplat-demo skelsplat-demo-people
