# Each target does everything on a fresh machine with Python 3.11 or newer. VERBOSE=1 shows all that Snakemake says.
PYTHON ?= python3
BIN := .venv/bin
SNAKEMAKE := $(BIN)/snakemake --cores 2
# Where it is set, each of a study's processes compiles all that it imports: seconds of every job.
unexport PYTHONDONTWRITEBYTECODE
# Names of folders may hold what a shell or make takes for its own.
export PATIENT MODELS
# Snakemake keeps a cache below the home folder, which a container or a service may not have.
ifneq ($(shell test -w "$$HOME" -a -d "$$HOME" && echo yes),yes)
export XDG_CACHE_HOME ?= $(CURDIR)/.snakemake/cache
endif

# What is shown, without CONFIG: the default study where it is finished, else the quick one where that is.
FINISHED := $(if $(wildcard results/provenance.json),,$(if $(wildcard results/quick/provenance.json),config/quick.yaml))
OF := $(addprefix --configfile ,$(or $(CONFIG),$(FINISHED)))

.PHONY: env quick study unlock report figures predict planner docs lint check check-house check-0 check-1 \
	test test-mechanics test-meshing test-study test-unit test-stages test-workflow test-full

env: .venv/installed

.venv/installed: envs/requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	|| { echo "Python 3.11 or newer is needed: make env PYTHON=/path/to/python3.11"; exit 1; }
	@test ! -L .venv || { echo ".venv is a link to a folder that would be emptied: remove the link"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	# Of 16,000 modules most are never imported; the others are compiled when they first are.
	$(BIN)/pip install --quiet --no-compile --requirement envs/requirements.lock
	touch $@

quick: env
	$(SNAKEMAKE) all report --configfile config/quick.yaml
	@$(BIN)/python workflow/show_results.py results/quick

study: env
	$(SNAKEMAKE) all report
	@$(BIN)/python workflow/show_results.py results

# After a study was killed (power, memory, kill): ends what it left running and lets the same command go on.
unlock: env
	$(BIN)/python workflow/unlock.py

# make report CONFIG=config/quick.yaml: of another study than the default one. Neither starts a study.
report figures: env
	$(SNAKEMAKE) $@ $(OF)

# make predict PATIENT=FOLDER: the face that follows each plan of a patient, by models that exist, on the mesh that they
# were trained on whatever study was run before. MODELS: an archive elsewhere. A table of many: snakemake predict.
predict: env
	@test -n "$$PATIENT" || { echo "Name the patient: make predict PATIENT=FOLDER"; exit 1; }
	$(BIN)/python workflow/predict.py "patient=$$PATIENT" $(if $(MODELS),"models=$$MODELS") $(addprefix --configfile ,$(CONFIG))

# make planner PATIENT=FOLDER: prepares the patient, then opens a page on this machine to try plans on. MODELS: an
# archive elsewhere; PLANNER: options of workflow/plan.py.
planner: env
	@test -n "$$PATIENT" || { echo "Name the patient: make planner PATIENT=FOLDER"; exit 1; }
	$(SNAKEMAKE) --config "patient=$$PATIENT" $(if $(MODELS),"models=$$MODELS") -- planner
	$(BIN)/python workflow/plan.py "results/patients/$$(basename "$$(realpath "$$PATIENT")")/planner.json" $(PLANNER)

docs: env
	$(BIN)/python workflow/document_config.py

lint: env
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/snakefmt --check Snakefile rules workflow
	$(BIN)/snakemake --lint

# Minutes: lint, rooms, configuration and pages, and the unit tests that import what has changed since main.
check: env
	$(MAKE) --jobs 2 --keep-going --output-sync=target check-0 check-1 check-house lint

check-house:
	$(BIN)/pytest tests/config tests/unit/test_rooms.py --ignore tests/config/test_commands.py

check-0 check-1: check-%:
	@files=$$($(BIN)/python tests/changed.py $* 2); test -z "$$files" || $(BIN)/pytest $$files

# All that protects a behaviour. What compiles loops comes first: two suites that began at once would compile them twice.
test: env
	@$(MAKE) --jobs 2 --keep-going --output-sync=target $(FIRST); first=$$?; \
	$(MAKE) --jobs 2 --keep-going --output-sync=target $(TESTS) && exit $$first

FIRST := test-mechanics test-meshing
# The longest first: the others fill what is left of two cores.
TESTS := test-unit test-study test-workflow test-stages lint

COMPILING := tests/unit/mechanics tests/unit/networks tests/unit/meshing

test-mechanics:
	$(BIN)/pytest tests/unit/mechanics tests/unit/networks

test-meshing:
	$(BIN)/pytest tests/unit/meshing

test-unit:
	$(BIN)/pytest tests/unit $(addprefix --ignore ,$(COMPILING))

# Tests that share the finished quick study.
test-study:
	$(BIN)/pytest tests/study -m "not full and studied"

test-stages:
	$(BIN)/pytest tests/stages

# All others, most of which run Snakemake.
test-workflow:
	$(BIN)/pytest --ignore tests/unit --ignore tests/stages -m "not full and not studied"

# Slow variants, sweeps and services. Needs what apt-get install munge slurm-wlm chromium brings; a test whose service is
# absent says so.
test-full: env
	$(BIN)/pytest -m full -rs
