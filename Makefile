# Each target does everything on a fresh machine with Python 3.11 or newer.
PYTHON ?= python3
BIN := .venv/bin
SNAKEMAKE := $(BIN)/snakemake --cores 2

.PHONY: env quick study unlock report planner test test-library test-study test-full docs

env: .venv/installed

.venv/installed: envs/requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	|| { echo "Python 3.11 or newer is needed: make env PYTHON=/path/to/python3.11"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/pip install --quiet --requirement envs/requirements.lock
	touch $@

quick: env
	$(SNAKEMAKE) --configfile config/quick.yaml

study: env
	$(SNAKEMAKE)

# After a study was killed (power, memory, kill): ends what it left running and lets the same command go on.
unlock: env
	$(BIN)/python workflow/unlock.py

# make report CONFIG=config/quick.yaml: of another study than the default one.
report: env
	$(SNAKEMAKE) report $(if $(CONFIG),--configfile $(CONFIG))

# make planner PATIENT=FOLDER: prepares the patient, then opens a page on this machine to try plans on. MODELS: an
# archive elsewhere; PLANNER: options of workflow/plan.py.
planner: env
	@test -n "$(PATIENT)" || { echo "Name the patient: make planner PATIENT=FOLDER"; exit 1; }
	$(SNAKEMAKE) --config patient=$(PATIENT) $(if $(MODELS),models=$(MODELS)) -- planner
	$(BIN)/python workflow/plan.py results/patients/$(notdir $(abspath $(PATIENT)))/planner.json $(PLANNER)

docs: env
	$(BIN)/python workflow/document_config.py

test: env
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/snakefmt --check Snakefile rules workflow/common.smk workflow/tables.smk
	$(BIN)/snakemake --lint
	$(MAKE) --jobs 2 --keep-going --output-sync=target test-library test-study

test-library:
	$(BIN)/pytest -m "not full and not studied"

test-study:
	$(BIN)/pytest -m "not full and studied"

# Needs what apt-get install munge slurm-wlm chromium brings; a test whose service is absent says so.
test-full: env
	$(BIN)/pytest -m full -rs
