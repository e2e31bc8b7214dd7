# Every target sets itself up: only Python 3.11 … 3.13 and make are needed. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PIP_DISABLE_PIP_VERSION_CHECK = 1
# Tests start hundreds of processes, each of which would compile the same modules again.
unexport PYTHONDONTWRITEBYTECODE

# With `exec` before it, so that SIGTERM to make reaches the program and not a shell around it.
ONE_THREAD := env OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

# The folders under the name by which they are imported, for what reads the sources and does not run them.
PACKAGE := build/package/probewatch

.DEFAULT_GOAL := help
.PHONY: help help-all setup demo test lint types contracts quick thorough invariant \
  gate-proof release-check failures live mutation pythons slow test-arm64 evidence evidence-full false-alarms coverage-page point-coverage crosswire crosswire-scans test-deb test-cart soak igtl-soak onlookers repeat coverage bench paper deb docs lock vulnerabilities clean

help: ##+ list the targets of every day
	@awk -F ':.*## ' '/^##@ /{title = "\n" substr($$0, 5)} /^[a-z0-9-]+:.*## /{if (title) print title; title = ""; printf "  %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@printf '\nAll others: make help-all\n'

help-all: ##+ list every target
	@awk -F ':.*##[+]? ' '/^##@ /{print "\n" substr($$0, 5)} /^[a-z0-9-]+:.*##[+]? /{printf "  %-16s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

##@ First

setup: $(VENV)/runtime ## probewatch itself, ready to use: .venv/bin/probewatch (under a minute)
	@echo "ready: $(BIN)/probewatch --help"

demo: $(VENV)/runtime ## a simulated cart: real protocol bytes, injected faults, alarm, timeline (under 3 minutes)
	$(BIN)/probewatch demo

test: $(VENV)/dev ## lint, types, import contracts and the quick test suite (about five minutes on two cores)
	@$(MAKE) --no-print-directory --jobs=2 lint types contracts quick

##@ Every change

lint: $(VENV)/dev ## ruff: style and formatting; vulture: what nothing uses
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/vulture

types: $(VENV)/dev $(PACKAGE) ## mypy --strict
	$(BIN)/mypy

contracts: $(VENV)/dev $(PACKAGE) ## who may import whom
	PYTHONPATH=$(dir $(PACKAGE)) $(BIN)/lint-imports

quick: $(VENV)/dev ## the quick test suite alone; in CI none of its tests takes more than 4 s of a processor
	PROBEWATCH_THIRD=$(THIRD) PROBEWATCH_MOST_CPU_S=4 $(BIN)/pytest -n 2 --durations=20 --dist worksteal -m "not thorough and not slow and not live and not cart and not deb"

thorough: $(VENV)/dev ## the heavier tests (half an hour, twice that on a slow machine); THIRD=1, 2 or 3 for a third of them, as the gate runs
	PROBEWATCH_THIRD=$(THIRD) $(BIN)/pytest --durations=20 -n 2 --dist worksteal -m "thorough and not slow and not live and not cart and not deb"

FRAMES ?= 25000
invariant: $(VENV)/dev ## the contact never outlives its evidence: 25,000 frames of random disturbances, others for each commit (four to seven minutes); SEED=… FRAMES=… for those of another run
	@exec $(ONE_THREAD) $(BIN)/python -m tests.invariant $(FRAMES) $(SEED)

##@ Before a release

gate-proof: $(VENV)/dev ## puts defects into a copy, one at a time: tests of the gate must fail for each (two minutes)
	@exec $(BIN)/python -m tests.rules.gate_proof

release-check: $(VENV)/dev ## everything there is, one part after the other, and a table of it (hours; root for the machine tests)
	@exec $(BIN)/python -m tests.rules.release

failures: $(VENV)/dev ## every row of docs/failures.md on a simulated cart in real time (about two minutes)
	$(BIN)/python -m tests.rules.retried -m "live and not slow" tests/live/test_failures.py

live: $(VENV)/dev ## the service, the demo and every device simulator in real time (a quarter of an hour)
	$(BIN)/python -m tests.rules.retried -n 2 --dist loadfile -rs --no-fold-skipped --durations=20 -m "live and not slow and not alone"
	$(BIN)/python -m tests.rules.retried -rs --no-fold-skipped --durations=20 -m "live and not slow and alone"

mutation: $(VENV)/dev ## changes the supervisor in one place after the other; the tests must notice 97 % (about five minutes)
	$(BIN)/python -m tests.rules.mutation

pythons: $(VENV)/dev ## the quick tests on the other Pythons this machine has; 3.13 from Debian's mirror, if need be (root); VERSIONS=3.13 for one, --by-turns for that of this commit and a third of the tests, as in the gate
	$(BIN)/python -m tests.rules.pythons $(VERSIONS)

slow: $(VENV)/dev ##+ the slow tests: statistics, memory over ten minutes
	$(BIN)/pytest -m "slow and not cart" -n 2

MEASURED = exec $(ONE_THREAD) $(BIN)/python -m probewatch.tools.development.evidence
WHERE = $(if $(SEEDS),--seeds $(SEEDS)) $(if $(JOBS),--jobs $(JOBS)) $(if $(SCHEDULER),--scheduler $(SCHEDULER))
evidence: $(VENV)/dev ##+ the short study of hazards and false alarms: docs/evidence.md (for two idle processors, about ten minutes)
	$(MEASURED) short $(WHERE)
	$(BIN)/python -m probewatch.tools.development.manual

evidence-full: $(VENV)/dev ##+ the same over 1,000 simulated hours: about 200 hours of one processor; SCHEDULER=tcp://… for a Dask cluster
	$(MEASURED) full $(WHERE)
	$(BIN)/python -m probewatch.tools.development.manual

false-alarms: $(VENV)/dev ##+ signs and names in healthy scanning, on paths without pictures (an hour of one processor for SEEDS=2; goes on where it ended)
	exec $(ONE_THREAD) $(BIN)/python -m probewatch.tools.development.false_alarms $(if $(SEEDS),--seeds $(SEEDS)) $(if $(JOBS),--jobs $(JOBS))
	$(BIN)/python -m probewatch.tools.development.manual

coverage-page: $(VENV)/dev ##+ how often healthy scanning is verified: docs/coverage.md (for two idle processors, about fifteen minutes, and longer for its worlds)
	$(MEASURED) coverage $(WHERE)
	$(MEASURED) worlds $(WHERE)
	$(BIN)/python -m probewatch.tools.development.manual

point-coverage: $(VENV)/dev ##+ how often the bound on the error of a point holds, over 520 sessions: docs/coverage.md (for two idle processors, about half an hour)
	$(MEASURED) points $(WHERE)
	$(BIN)/python -m probewatch.tools.development.manual

test-deb: deb ##+ builds the packages, then looks at what is in them and runs what this machine's Python can
	$(BIN)/pytest -n 0 -m deb -rs tests/systemd/test_deb.py

test-cart: $(VENV)/dev ##+ a whole machine: package, service, kernel devices, power cuts (root; 13 to 18 minutes)
	$(BIN)/pytest -vv -n 2 --dist loadfile --no-loadscope-reorder -m "cart and not slow" -rsP --durations=20 \
	  --ignore=tests/cart/test_guest_plugs.py tests/cart
	$(BIN)/pytest -vv -n 0 -m "cart and not slow" -rsP tests/cart/test_guest_plugs.py

test-arm64: $(VENV)/dev ##+ the package for arm64 under qemu-user: figures beside this machine's, then the quick tests (root; hours); ARM64_TESTS=tests/drivers for some
	$(BIN)/python -m tests.arm64 $(ARM64_TESTS)

HOURS ?= 8
igtl-soak: $(VENV)/dev ##+ the OpenIGTLink traffic of 8 hours, as fast as it goes: memory and descriptors (some twelve minutes)
	$(BIN)/python -m tests.tools.openigtlink.soak $(HOURS)

soak: $(VENV)/dev ##+ half an hour of service in a container: memory, files, dropped frames, processor share (root)
	$(BIN)/pytest -m "cart and slow" -rs -s tests/cart

##@ Looking closer

TIMES ?= 50
repeat: $(VENV)/dev ##+ one test fifty times: make repeat TEST=tests/live/test_failures.py
	@failed=0; for i in $$(seq $(TIMES)); do $(BIN)/pytest -q $(TEST) || { failed=$$((failed + 1)); echo "repeat $$i failed"; }; \
	  done; echo "$$failed of $(TIMES) repeats failed"; [ "$$failed" -eq 0 ]

coverage: $(VENV)/dev ## which lines the quick tests reach: a table, and results/coverage/index.html
	$(BIN)/pytest -n 2 --dist worksteal -m "not thorough and not slow and not live and not cart and not deb" \
	  --cov --cov-report=term:skip-covered --cov-report=html:results/coverage

bench: $(VENV)/bench ## registration beside its peers and bounds, the cost of the line and of the way to it: tables and results/bench.json
	$(BIN)/python -m tests.bench

SWITCHES ?= 400
onlookers: $(VENV)/dev ##+ from detecting to the open contact, with everything that looks on and without, in turns: p99 and its interval (half an hour)
	$(BIN)/python -m tests.bench.onlookers $(SWITCHES)

VIEWS ?= 2000
SCANS ?= 200
crosswire: $(VENV)/dev ##+ the cross-wire tool on 2,000 rendered views, on as many held out and of another renderer, and on 200 scans (half an hour of one processor)
	exec $(ONE_THREAD) $(BIN)/python -m tests.crosswire $(VIEWS) $(SCANS)

crosswire-scans: $(VENV)/dev ##+ 200 guided scans with pictures, held out; goes on where the last run ended (an hour and a half of one processor)
	exec $(ONE_THREAD) $(BIN)/python -m tests.crosswire pictures $(SCANS) results/crosswire-scans.jsonl

paper: $(VENV)/dev ##+ Table 1 and Figure 4 of the paper on the simulator: results/paper, docs/paper.md
	$(BIN)/python -m tests.paper

##@ Making

deb: $(VENV)/dev ## the Debian packages for bookworm and trixie, in dist/; SUITES=bookworm for one
	$(BIN)/python systemd/deb/build.py dist $(SUITES)

docs: $(VENV)/dev ## write pages, tables and the unit's DeviceAllow from tables, drivers, code, tests and the last study
	$(BIN)/python -m probewatch.tools.development.manual

lock: $(VENV)/dev ##+ resolve the lock files again from pyproject.toml
	$(BIN)/pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --no-strip-extras --python-version 3.11 --generate-hashes --no-annotate \
	  --custom-compile-command 'make lock' --extra dev pyproject.toml -o requirements-dev.lock
	$(BIN)/uv pip compile --quiet --universal --no-strip-extras --python-version 3.11 --generate-hashes --no-annotate \
	  --custom-compile-command 'make lock' -c requirements-dev.lock pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --universal --no-strip-extras --python-version 3.11 --generate-hashes --no-annotate \
	  --custom-compile-command 'make lock' -c requirements-dev.lock --extra bench pyproject.toml -o requirements-bench.lock

AUDIT := .venv-audit
vulnerabilities: $(VENV)/bin/python ##+ pip-audit of what the package is made of; exit code 2 and "not checked" without its database
	@[ -x $(AUDIT)/bin/pip-audit ] || { $(PYTHON) -m venv $(AUDIT) && $(AUDIT)/bin/pip install --quiet 'pip-audit>=2.7,<3'; } || \
	  { echo "NOT CHECKED: pip-audit cannot be installed here" >&2; exit 2; }
	$(BIN)/python -m probewatch.tools.development.vulnerabilities $(AUDIT)/bin/pip-audit requirements.lock

clean: ## remove what the targets made
	rm -rf $(VENV) $(VENV)-3.* $(AUDIT) appliance/core/registration/_compiled*.so build dist results .mypy_cache .pytest_cache .ruff_cache .hypothesis

COMPILED := $(wildcard appliance/core/registration/*.[ch]) tools/development/compile_core.py

$(VENV)/runtime: requirements.lock pyproject.toml $(COMPILED) | $(VENV)/bin/python
	$(BIN)/pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --no-deps --editable .
	@touch $@

$(VENV)/dev: requirements-dev.lock pyproject.toml $(COMPILED) | $(VENV)/bin/python
	$(BIN)/pip install --quiet --require-hashes -r requirements-dev.lock
	$(BIN)/pip install --quiet --no-deps --editable .
	@touch $@ $(VENV)/runtime

$(PACKAGE):
	mkdir -p $@
	ln -sfnr -t $@ appliance drivers tools tools/development/package/probewatch/__init__.py

$(VENV)/bench: requirements-bench.lock $(VENV)/dev
	$(BIN)/pip install --quiet --require-hashes -r requirements-bench.lock
	@touch $@

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || { \
	  echo "probewatch needs Python 3.11, 3.12 or 3.13; '$(PYTHON)' is $$($(PYTHON) --version 2>&1)." >&2; \
	  echo "Install one (Debian 12 and 13: apt install python3) or name it: make PYTHON=python3.12 demo" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "Python's venv module is missing. On Debian: apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
