# The two commands: `make demo` and `make test`. Both set everything up by themselves.
PYTHON ?=
SCENARIO ?= 1b
RUNS ?= 20
BIN := .venv/bin

# Tests start Python a hundred times: it is not to compile everything as often, whatever the environment says.
unexport PYTHONDONTWRITEBYTECODE

# So many tests at the same time: as many as there are cores, three times as many where most wait for other programs.
JOBS ?= auto
MORE_JOBS ?= $(shell echo $$((3 * $$(getconf _NPROCESSORS_ONLN))))
AT_ONCE := --numprocesses $(MORE_JOBS) --dist loadscope --no-loadscope-reorder

.PHONY: setup ros2 demo test tests lint lint-python javascript unit coverage integration system properties browser scenarios building-runs energy-runs fault-runs traffic-runs model-check benchmarks bench-codmap bench-coordination docs docs-site docs-serve distribution sbom clean kill-runs adapter-runs attack upgrade-runs mutants slow

setup: .venv/.ready

.venv/.ready: pyproject.toml constraints.txt scripts/setup
	@scripts/setup "$(PYTHON)"

# A Python with ROS 2, for the tests of its adapter and for Scenario 6.
ros2: setup
	@scripts/ros2

demo: setup $(if $(filter 6,$(SCENARIO)),ros2)
	@$(BIN)/somrs demo $(SCENARIO) $(if $(ARCOS),--arcos) $(if $(SEED),--seed $(SEED)) --out out/scenario-$(SCENARIO)$(if $(ARCOS),-arcos)

test:
	@scripts/test

# Tests of several parts and of whole systems, all at once. With ROS2_MEANWHILE=1, those with ROS 2 wait until it is set up.
tests: setup $(if $(ROS2_MEANWHILE),,ros2)
	@$(BIN)/pytest tests/integration tests/system $(AT_ONCE)

unit: setup
	@$(BIN)/pytest tests/unit --numprocesses $(JOBS) --dist worksteal

# Unit and integration tests, and the share of the lines of src that they run.
coverage: setup ros2
	@scripts/coverage tests/unit tests/integration $(AT_ONCE)

integration: setup ros2
	@$(BIN)/pytest tests/integration $(AT_ONCE)

system: setup ros2
	@$(BIN)/pytest tests/system $(AT_ONCE)

# Property tests with many times as many examples, and others every time.
properties: setup ros2
	@EXAMPLES=$(or $(EXAMPLES),20) $(BIN)/pytest tests/unit tests/integration -m hypothesis $(AT_ONCE)

lint: lint-python
	@scripts/javascript lint

lint-python: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python scripts/names.py

# The JavaScript modules of the windows: ESLint, and their unit tests in node.
javascript: setup
	@scripts/javascript lint test

# The windows in a real browser; pictures of the pages come to out/screenshots. LATENCY=400 makes messages late, for tests
# that do not wait for what they need.
browser: setup
	@scripts/javascript setup
	@SOMRS_BROWSER_LATENCY=$(or $(LATENCY),0) $(BIN)/pytest tests/browser --numprocesses $(JOBS) --dist loadscope --no-loadscope-reorder

# Slow suites: each prints `N passed, N failed`.

# The tests that take too long for `make test`: the package as it is installed elsewhere, programs of the tutorials, systems with another of the
# same kind (of certificates, of foreign software, of what is killed), large model checks, changes to the program that
# tests have to notice, and every page in every look.
slow: setup ros2
	@scripts/javascript setup
	@ALL_LOOKS=1 $(BIN)/pytest tests -m "slow or looks" $(AT_ONCE)

scenarios: setup
	@$(BIN)/python -m verification.scenarios --runs $(RUNS) $(if $(ARCOS),--arcos) $(if $(SEED),--first $(SEED))

traffic-runs: setup
	@$(BIN)/python -m verification.traffic_runs $(if $(SEED),--seed $(SEED),--runs $(or $(N),1000) --seed-base $(or $(SEED_BASE),0))

energy-runs: setup
	@$(BIN)/python -m verification.energy_runs --hours $(or $(HOURS),168) --runs $(or $(N),1) --seed-base $(or $(SEED_BASE),0)

# Buildings of Open-RMF with all their storeys: BUILDINGS="..." selects others.
building-runs: setup
	@$(BIN)/python -m verification.building_runs $(BUILDINGS) --runs $(or $(N),2) --seed-base $(or $(SEED_BASE),0)

fault-runs: setup
	@$(BIN)/python -m verification.fault_runs $(if $(SEED),--seed $(SEED),--runs $(or $(N),1000) --seed-base $(or $(SEED_BASE),0))

# Every state of the protocol that can be reached; with MUTATE=1, each entry of its tables altered in turn.
model-check: setup
	@$(BIN)/python -m verification.model_check $(if $(MUTATE),--mutations)

# Those of traffic are all in one run, of traffic.py.
benchmarks: setup
	@for file in $(filter-out benchmarks/grids.py benchmarks/hall.py,$(wildcard benchmarks/*.py)); do echo "== $$file"; $(BIN)/python $$file || exit 1; done

# Kills adapters, the other ends of their wires, and brokers, while robots drive.
adapter-runs: setup ros2
	@$(BIN)/python -m verification.adapter_runs $(if $(N),--runs $(N)) $(if $(SEED_BASE),--first $(SEED_BASE))

# Kills real processes at every type of message of the protocol; SEED=17 plays one run once more.
kill-runs: setup
	@$(BIN)/python -m verification.kill_runs $(if $(BUS),--bus) $(if $(PLANNED),--planned) $(if $(N),--runs $(N)) $(if $(SEED_BASE),--first $(SEED_BASE)) $(if $(SEED),--seed $(SEED))

# What the servers of a running system promise to refuse, and what befalls its machine; SEED=17 draws the same messages once more.
attack: setup
	@$(BIN)/python -m verification.attack --fuzz $(or $(N),20000) $(if $(SEED),--seed $(SEED)) --only "$(ONLY)"

# A system of the last release is killed amid tasks and started again with today's code; SEED=17 plays one run once more.
upgrade-runs: setup
	@$(BIN)/python -m verification.upgrade_runs $(if $(N),--runs $(N)) $(if $(SEED),--seed $(SEED))

# Small changes of the core, one at a time: a test has to fail. SEED=17 is the same sample once more, ONLY=FILE:LINE:NUMBER one alone,
# WITHIN=5 a quick look with the fastest tests; docs/verification/mutants.md has more.
mutants: setup
	@$(BIN)/python -m verification.mutants $(if $(N),--sample $(N)) $(if $(SEED),--seed $(SEED)) $(if $(ONLY),--only "$(ONLY)") $(if $(WITHIN),--within $(WITHIN)) $(if $(JOBS:auto=),--jobs $(JOBS))

# Published multi-agent planning problems, from their files to the goal; DIR has a folder for each domain, and in it one a problem.
bench-codmap: setup
	@$(BIN)/python -m verification.codmap "$(DIR)" --limit $(or $(LIMIT),60) --faults $(or $(FAULTS),0) --seed $(or $(SEED),0) --only "$(ONLY)"

# Conversations per second, beside SPADE and DBOS where they are installed: pip install -e '.[rivals]'
bench-coordination: setup
	@$(BIN)/python benchmarks/coordination.py

# What is generated: the state diagrams and the JSON Schema.
docs: setup
	@$(BIN)/python -m somrs.protocol.frp.diagram docs/reference/frp-states.md
	@$(BIN)/somrs schema --out src/somrs/ontology/data/somrs.schema.json

# The wheel and the source distribution, in dist/; then the wheel in an environment of its own, outside, with all it needs installed anew.
distribution: setup
	@$(BIN)/python -m build --no-isolation
	@WITH_DEPENDENCIES=1 $(BIN)/pytest tests/system/test_distribution.py -m slow

# What an installation consists of, for tools that look for known weaknesses: out/sbom.json, in the CycloneDX format.
sbom: setup
	@scripts/sbom

# The documentation as a site, in out/site; a broken link is an error. Neither building nor reading it needs a network.
docs-site: setup
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet
	@echo "The documentation is in out/site. To read it with its search and its diagrams: make docs-serve"

# Browsers run no search and load no modules for pages that are opened as files.
docs-serve: docs-site
	@echo "The documentation is at http://127.0.0.1:$(or $(PORT),8000) until Ctrl-C"
	@$(BIN)/python -m http.server --bind 127.0.0.1 --directory out/site $(or $(PORT),8000) >/dev/null 2>&1 \
		|| { echo "port $(or $(PORT),8000) cannot be used; select another: make docs-serve PORT=8001"; exit 1; }

clean:
	@rm -rf .venv node_modules out .somrs build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
