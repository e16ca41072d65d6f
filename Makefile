# Everything runs in .venv, which `make` builds from environment.txt when it is missing or outdated.

PYTHON  ?= python3
PROFILE ?= paper
SEED    ?=
OUT     ?= $(if $(filter paper,$(PROFILE)),figures,runs/$(PROFILE))
JOBS    ?= 2
NOISE   ?= 0,0.5,1,2,4
SEEDS   ?= 2
ARGS    ?=

SHELL       := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

bin   := .venv/bin
ready := .venv/.ready

# Open3D starts no web server.
export OPEN3D_DISABLE_WEB_VISUALIZER := true

# Notebooks keep their pictures only with the inline backend, which needs no display either.
unexport MPLBACKEND

# Tests run in JOBS processes, so each of them keeps to one thread.
one_thread := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 NUMBA_NUM_THREADS=1

.PHONY: help setup reproduce sweep test lint readme bench lab clean distclean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	@echo
	@echo "  Variables: PROFILE=quick|paper SEED=N OUT=DIR (reproduce), JOBS=N (test),"
	@echo "             NOISE=0,1,2 SEEDS=N (sweep),"
	@echo "             PYTHON=python3.12 (setup), ARGS=... (more arguments for the tool)"

setup: $(ready) ## build .venv from environment.txt; installs missing system libraries

$(ready): environment.txt pyproject.toml tools/setup.sh
	tools/setup.sh "$(PYTHON)"
	touch $@

reproduce: $(ready) ## make every table and figure into OUT: figures, or runs/quick with PROFILE=quick
	$(bin)/paperrepro reproduce --profile "$(PROFILE)" --out "$(OUT)" $(if $(SEED),--seed "$(SEED)") $(ARGS)

sweep: $(ready) ## execute a notebook over noise levels and seeds, into sweeps/small; goes on if stopped
	$(bin)/paperrepro sweep --grid noise_scale="$(NOISE)" --seeds "$(SEEDS)" --out sweeps/small $(ARGS)

test: lint ## lint, tests, then every notebook on its quick profile
	$(one_thread) MPLBACKEND=Agg $(bin)/python -m pytest -n $(JOBS) --dist worksteal tests $(ARGS)
	$(one_thread) $(bin)/python -m pytest -n $(JOBS) --nbmake --nbmake-timeout=1800 notebooks

lint: $(ready) ## ruff on the packages, tests and notebooks
	$(bin)/ruff check .
	$(bin)/ruff format --check .

readme: $(ready) ## put the claims of figures/claims.csv into README.md
	$(bin)/python -c "import pandas as pd, paperrepro as pr; tables = pr.paper.tables; \
	    tables.update_between_markers('README.md', 'claims', \
	    tables.markdown_summary(pd.read_csv('figures/claims.csv')))"

bench: $(ready) ## time every stage beside its peers, into OUT
	$(bin)/python -m tests.benchmarks --out "$(OUT)" $(ARGS)

# tools/jupyter: no offer to build an extension that came with Open3D, no news.
lab: $(ready) ## open notebooks and results in JupyterLab
	JUPYTER_CONFIG_PATH=tools/jupyter $(bin)/jupyter lab $(if $(filter 0,$(shell id -u)),--allow-root) \
	    --LabApp.default_url=/lab/tree/notebooks/00_start_here.ipynb $(ARGS)

clean: ## remove what tools leave, runs/ and executed notebooks; not sweeps/, not the cache
	rm -rf build dist runs figures/executed .pytest_cache .ruff_cache .benchmarks -- *.egg-info
	find . -path ./.venv -prune -o \( -name __pycache__ -o -name .ipynb_checkpoints \) -type d -prune -exec rm -rf {} +

distclean: clean ## clean, and remove .venv
	rm -rf .venv
