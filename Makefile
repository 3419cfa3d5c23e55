# make demo | test | bench | lint | figures | docs | pages: each works as the only command after a clone, given Rust and Python 3.11 or newer.
# Everything is installed into .venv from the package index that pip is configured with.

VENV := .venv
BIN := $(VENV)/bin
export PATH := $(CURDIR)/$(BIN):$(PATH):$(HOME)/.cargo/bin
export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

SOURCES := $(shell find src -name '*.rs') Cargo.toml Cargo.lock
DEMO_EXTRAS := mesh,viz

PAGES := python/cyclorama/pages/visibility.js

.PHONY: demo test bench lint figures docs pages clean
.NOTPARALLEL:
.DELETE_ON_ERROR:

# On a real mesh where one lies beside the clone, else on a gear; the pictures go to out/.
demo: $(VENV)/.demo $(VENV)/.built
	$(BIN)/cyclorama demo $(or $(MESH),$(wildcard ../shared/data/bunny.ply))

# Kernel tests only: the crate has no doctest that runs, and without --lib it is compiled twice. Panics say where they are
# without debug information, which takes long to write.
test: lint pages
	CARGO_PROFILE_TEST_DEBUG=false cargo test --quiet --lib
	$(BIN)/python -m pytest

bench: $(VENV)/.test $(VENV)/.built target/embree16
	$(BIN)/python benches

lint: $(VENV)/.test $(VENV)/.built $(VENV)/.rust
	cargo fmt --check
	cargo clippy --quiet --all-targets -- -D warnings
	cargo clippy --quiet --all-targets --features python -- -D warnings
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest cyclorama._core --mypy-config-file pyproject.toml \
	  --allowlist tools/stubtest-allowed --ignore-disjoint-bases

# Every picture in README and docs, and docs/failures.md. What needs a mesh or a browser that is not there stays as it is.
figures: $(VENV)/.test $(VENV)/.built
	$(BIN)/python tools/draw-failures
	$(BIN)/python tools/draw-figures

# The documentation, from docs/ and the docstrings: build/site/index.html, which needs no network.
docs: $(VENV)/.test $(VENV)/.built
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet

# The scripts of pages and widgets, bundled from npm's three.js. Where there is no Node.js it says so, and pages do too.
pages: $(PAGES)

$(PAGES): $(wildcard web/src/*.js web/src/*/*.js) web/build.mjs web/package-lock.json
	@command -v npm >/dev/null || tools/system-packages nodejs npm
	@if command -v npm >/dev/null; then cd web && npm ci --silent --no-fund --no-audit && npm run --silent build; \
	  else echo "pages: no Node.js here to bundle them with"; fi

# Embree's packets of 16 rays, to race against; the bench says so where libembree-dev is not to be had.
target/embree16: benches/embree16/packets.cpp
	@mkdir -p target
	tools/system-packages g++ libembree-dev valgrind
	-test ! -e /usr/include/embree3/rtcore.h || $(CXX) -std=c++20 -O3 -march=native -Wall -Wextra $< -lembree3 -pthread -o $@

clean:
	rm -rf $(VENV) target out web/node_modules python/cyclorama/pages/*.js

# The extension follows the Rust sources; the Python sources are used in place.
$(VENV)/.built: $(SOURCES) | $(VENV)/.demo
	$(BIN)/maturin develop --release --quiet --skip-install
	@touch $@

$(VENV)/.demo: pyproject.toml | $(VENV)/.python
	$(BIN)/pip install --quiet --editable '.[$(DEMO_EXTRAS)]'
	@touch $@ $(VENV)/.built

# Of the system packages, libusb is for Open3D, Chromium looks at pages, POV-Ray draws panoramas, the rest give pyrender EGL and a software OpenGL.
$(VENV)/.test: pyproject.toml tools/system-packages | $(VENV)/.python
	tools/system-packages libusb-1.0-0 libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri chromium povray
	$(BIN)/pip install --quiet --editable '.[test]'
	@touch $@ $(VENV)/.demo $(VENV)/.built

$(VENV)/.rust:
	@cargo fmt --version >/dev/null && cargo clippy --version >/dev/null || rustup component add rustfmt clippy
	@touch $@

# PYTHON=... picks the interpreter; Debian keeps venv in a package of its own.
$(VENV)/.python:
	@python=$$(tools/find-python $(PYTHON)) && { $$python -m venv $(VENV) || \
	  { tools/system-packages python3-venv && $$python -m venv --clear $(VENV); }; }
	$(BIN)/python -m pip install --quiet 'maturin>=1.16,<2'
	@touch $@
