# A thin face over CMake. `make help` lists what there is.
.DEFAULT_GOAL := build
PREFIX ?= /usr/local
.PHONY: help deps deps-all build install run test test-long bench fuzz reference format lint clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

deps: ## install the Debian packages that a build and its tests need
	@scripts/deps.sh

deps-all: ## those, and what the sanitizers, fuzzers and other processors of test-long need
	@scripts/deps.sh --all

build: ## build programs, tests and benches (release) into build/release/bin
	@scripts/build.sh release

# It builds no more than is missing: often root installs what somebody else has built.
install: ## install programs, library and documents below $(DESTDIR)$(PREFIX); PREFIX is /usr/local unless set
	@if [ -e build/release/build.ninja ]; then cmake --build build/release --target programs; \
	  else scripts/build.sh release programs; fi
	@DESTDIR="$(DESTDIR)" cmake --install build/release --prefix "$(PREFIX)"

run: deps ## light the built-in atrium; the server says what to do next
	@scripts/build.sh release programs
	@exec build/release/bin/lightwelld builtin:atrium --animate

test: deps build ## the fast tests: unit, golden, reference, integration; names the ten slowest
	@scripts/check.sh fast

test-long: deps-all ## other checks, long tests, the fast ones ten times under load, each fuzzer for a while
	@scripts/check.sh gcc clang dev tsan arm64 rays-all isa long flakes fuzz

bench: build ## what each kernel costs and how far it is from bare rays: one table, and bench.json
	@tests/bench/bench.py $(BENCH_SCENES)

fuzz: deps-all ## run each fuzzer for FUZZ_SECONDS (default 60)
	@FUZZ_SECONDS=$${FUZZ_SECONDS:-60} scripts/check.sh fuzz

reference: deps ## the reference of liblightwell, into build/reference/html
	@mkdir -p build
	@doxygen docs/Doxyfile

format: ## lay out the code by .clang-format
	@git ls-files '*.c' '*.h' | xargs clang-format -i

lint: ## check the arrows between folders, stems, what documents name, and layout
	@scripts/lint.sh --format

clean: ## remove all builds
	@rm -rf build
