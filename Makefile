# Builds, tests and runs calor. `make help` lists what can be asked for.
#
# fpm does the building. It is given `--flag` and never `--profile`: fpm's own profiles (its default
# too) contain -fcoarray=single, which changes how gfortran lays out derived types, and then the
# tests crash where the precompiled stand-in for test-drive is used (see tools/set_up.sh). For the same
# reason, use `fpm test --flag "-O2"` there when calling fpm by hand.

.DEFAULT_GOAL := build
.NOTPARALLEL:
# Where `make install` puts things.
PREFIX ?= /usr/local

.PHONY: help build run install test test-checked examples lint format pictures hard-cases cost documents \
  docs outside steppers verification absent-effects bench fuzz kill-runs set-up clean distclean \
  distributed test-distributed test-distributed-checked scaling
SHELL := /bin/bash

RELEASE_FLAGS := -O3 -march=native
CHECKED_FLAGS := -Og -g -fcheck=all,no-array-temps -finit-real=snan -ffpe-trap=invalid,zero,overflow \
  -fsanitize=address,undefined -fno-sanitize-recover=undefined \
  -Wall -Wextra -Wimplicit-interface -Wno-maybe-uninitialized -Wno-compare-reals

# PETSc and hypre do not take traps of exceptions, nor sanitizers MPI.
CHECKED_RANKS_FLAGS := -Og -g -fcheck=all,no-array-temps -finit-real=snan

# What one build consists of; `test-checked` sets these three anew.
FLAGS    ?= $(RELEASE_FLAGS)
CASES    ?= 20000
KILLS    ?= 200
SEED     ?= 1
LIMIT    ?= inf
BIN      ?= bin
EXAMPLES ?= build/examples
# What is checked and indented.
SOURCES = $(wildcard src app test example example-project/app distributed/src distributed/app \
  distributed/test)
DOCUMENTS = README.md CHANGELOG.md $(wildcard docs/*.md)

# Libraries that a program does not call are not tied to it.
FPM_OPTIONS = --flag "$(strip $(FLAGS))" --link-flag "-Wl,--as-needed"
FPM         = .venv/bin/fpm
# After a failed compilation fpm would take the library's archive of before for the new one.
OR_FORGET   = || { rm -f build/gfortran_*/calor/libcalor.a*; exit 1; }

# set_up.sh puts a link to the serial HDF5's description there.
export PKG_CONFIG_PATH := $(CURDIR)/build/pkgconfig:$(PKG_CONFIG_PATH)

# Where the tests find the programs that they run.
export CALOR_PROGRAM  = $(abspath $(BIN))/calor
export CALOR_EXAMPLES = $(abspath $(EXAMPLES))

# Threads of tests and measurements spin as briefly as those of the program: see app/brief_waiting.f90.
export GOMP_SPINCOUNT ?= 1000

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/\1|\2/p' $(MAKEFILE_LIST) | \
	while IFS='|' read -r name text; do printf 'make %-14s %s\n' "$$name" "$$text"; done

build: set-up ## the program, at bin/calor (installs what is missing; the default)
	@tools/drop_stale.sh
	@$(FPM) run $(FPM_OPTIONS) --target calor --runner "tools/place.sh $(BIN)" $(OR_FORGET)

run: build ## build, and run the heat problem data/plate.nml
	$(BIN)/calor run data/plate.nml

install: build ## the program, its manual page and completion under PREFIX (/usr/local)
	install -D -m 755 $(BIN)/calor $(DESTDIR)$(PREFIX)/bin/calor
	install -d $(DESTDIR)$(PREFIX)/share/man/man1 $(DESTDIR)$(PREFIX)/share/bash-completion/completions
	$(BIN)/calor manual >$(DESTDIR)$(PREFIX)/share/man/man1/calor.1
	$(BIN)/calor completion >$(DESTDIR)$(PREFIX)/share/bash-completion/completions/calor

examples: set-up ## the programs of example/, in build/examples
	@tools/drop_stale.sh
	@mkdir -p $(EXAMPLES)
	@$(if $(wildcard example/*.f90),$(FPM) run $(FPM_OPTIONS) --example --all \
	  --runner "tools/place.sh $(EXAMPLES)" $(OR_FORGET))

test: build examples ## all tests; SUITE=text runs one suite, TEST="numbers as text" one test of it
	@tools/drop_stale.sh
	@$(FPM) test $(FPM_OPTIONS) -- $(if $(SUITE),"$(SUITE)") $(if $(TEST),"$(TEST)")

# Leak detection needs ptrace, which many containers forbid.
test-checked: ## all tests in a build with run-time checks and sanitizers (slow)
	@ASAN_OPTIONS=detect_leaks=0 $(MAKE) --no-print-directory test \
	  FLAGS='$(CHECKED_FLAGS)' BIN=build/checked/bin EXAMPLES=build/checked/examples

# The second fpm package. Its library is calor's, compiled for MPI's compiler into a build of its own.
# The shell asks for PETSc's place, not make, which would ask before the set-up has installed it.
FPM_DISTRIBUTED = ../$(FPM)
DISTRIBUTED_OPTIONS = --compiler mpifort \
  --flag "$(strip $(FLAGS)) $$(pkg-config --cflags-only-I petsc)" \
  --link-flag "$$(pkg-config --libs-only-L petsc) -Wl,--as-needed"
MPIRUN ?= mpirun --oversubscribe $(if $(filter 0,$(shell id -u)),--allow-run-as-root)

distributed: ## calor-mpi, at bin/calor-mpi: the same scenes on PETSc over MPI (installs these)
	@tools/set_up.sh distributed
	@tools/drop_stale.sh distributed
	@cd distributed && $(FPM_DISTRIBUTED) run $(DISTRIBUTED_OPTIONS) --target calor-mpi \
	  --runner "../tools/place.sh $(abspath $(BIN))" || { rm -rf build/mpifort_*; exit 1; }

test-distributed: build distributed ## the tests of calor-mpi, on up to 8 ranks; SUITE=, TEST=
	@mkdir -p build/test-distributed
	@cd distributed && CALOR_MPI_PROGRAM=$(abspath $(BIN))/calor-mpi CALOR_MPIRUN="$(strip $(MPIRUN))" \
	  OMP_NUM_THREADS=1 $(FPM_DISTRIBUTED) test $(DISTRIBUTED_OPTIONS) \
	  --runner "$(CURDIR)/tools/run_in.sh $(CURDIR)/build/test-distributed" -- \
	  $(if $(SUITE),"$(SUITE)") $(if $(TEST),"$(TEST)")

test-distributed-checked: ## the tests of calor-mpi in a build with run-time checks (slow)
	@$(MAKE) --no-print-directory test-distributed FLAGS='$(CHECKED_RANKS_FLAGS)' BIN=build/checked/bin

scaling: build distributed ## measure anew the tables of docs/scaling.md (minutes)
	@tools/scaling.sh $(BIN)

fuzz: build ## feed 20000 damaged scenes and clouds to a build with sanitizers (an hour); CASES=, SEED=, LIMIT= in s
	@$(MAKE) --no-print-directory build FLAGS='$(CHECKED_FLAGS)' BIN=build/checked/bin
	@tools/fuzz.py build/checked/bin/calor $(BIN)/calor --count $(CASES) --seed $(SEED) \
	  --seconds $(LIMIT)

kill-runs: build ## kill runs 200 times, resume them, compare what they leave (minutes); KILLS=
	@tools/kill_runs.py $(BIN)/calor --count $(KILLS) --seed $(SEED)

lint: ## check the sources (fortitude's rules, the format), the documents' spelling and links
	@tools/set_up.sh lint
	@.venv/bin/fortitude check --quiet $(SOURCES)
	@tools/format.sh --check $(SOURCES)
	@.venv/bin/codespell --ignore-words tools/words.txt $(DOCUMENTS)
	@tools/check_links.py $(DOCUMENTS)

format: ## indent the sources as `make lint` wants them
	@tools/set_up.sh lint
	@tools/format.sh $(SOURCES)

pictures: examples ## draw the pictures of the documentation anew
	@tools/pictures.sh $(EXAMPLES) docs/pictures

hard-cases: examples ## make anew the tables and the picture of docs/hard-cases.md (minutes)
	@scratch=$$(mktemp) && $(EXAMPLES)/hard_cases spectrum >$$scratch && \
	gnuplot -e "data='$$scratch'; picture='docs/pictures/spectrum.png'" tools/spectrum.gnuplot && \
	rm $$scratch
	@OMP_NUM_THREADS=1 CALOR_KINDS=study tools/documents.sh

cost: build ## measure anew the tables and pictures of docs/accuracy-and-cost.md (minutes)
	@tools/cost.sh $(BIN)/calor

steppers: examples ## measure anew what time integrators cost against what was foreseen (minutes)
	@OMP_NUM_THREADS=1 CALOR_KINDS=study tools/documents.sh docs/steppers.md

verification: examples ## run the scenes of data/verification and write their table anew
	@CALOR_KINDS=table tools/documents.sh docs/verification-scenes.md

absent-effects: set-up ## count what effects cost a scene without them (minutes; needs valgrind)
	@tools/absent_effects.sh

bench: build examples ## measure speed beside other programs (minutes); SIZE=0.01 to try it
	@tools/set_up.sh bench
	@.venv-bench/bin/python bench/bench.py $(EXAMPLES)/bench $(BIN)/calor build/bench $(SIZE)
	@$(if $(SIZE),,.venv-bench/bin/python bench/put_tables.py build/bench docs)

documents: build examples ## make anew what the documents quote from the programs
	@tools/documents.sh
	@tools/sessions.py

docs: ## pages about all modules, by FORD, in build/api; a warning is an error
	@tools/set_up.sh docs
	@.venv-docs/bin/ford ford.md >build/api.log 2>&1 || { cat build/api.log; exit 1; }
	@if grep -A1 -i warning build/api.log; then exit 1; fi
	@echo "The pages begin at build/api/index.html."

outside: build ## see that calor installs, and serves a project outside (minutes)
	@tools/outside.sh "$(strip $(FLAGS))" "-Wl,--as-needed"

set-up: ## install what is missing, build nothing
	@tools/set_up.sh

clean: ## remove what was built
	rm -rf bin build/checked build/examples build/gfortran_* build/cache.toml \
	  build/compile_commands.json build/test-distributed distributed/build

distclean: clean ## remove what was built and what was installed here (Debian packages stay)
	rm -rf build distributed/build .venv .venv-vtk .venv-bench .venv-docs
