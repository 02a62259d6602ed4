# What this project can do, one word each. `make` alone lists them.
#
# Every target sets up what it needs first, in a .venv beside this file, and is quick when nothing has changed.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup demo study pictures gallery docs assets vendor test test-all test-train bench lint lock clean

PYTHON ?= python3
# Blender's Python module has wheels for one Python only.
PYTHON_ASSETS ?= python3.11
PYTEST_WORKERS ?= 2
PYTEST := .venv/bin/python -m pytest -n $(PYTEST_WORKERS) --dist loadfile
export PYTHON

# Settings of the caller's shell that would bend what is installed or imported here.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE PIP_USER PIP_TARGET PIP_PREFIX
unexport UV_SYSTEM_PYTHON VIRTUAL_ENV CONDA_PREFIX SUMO_HOME PROJ_LIB PROJ_DATA GDAL_DATA
export PYTHONNOUSERSITE := 1
export MPLBACKEND := Agg
# uv trusts what the system trusts, as pip and cargo do.
export UV_SYSTEM_CERTS := 1

help:  ## This list
	@printf '\nPaveTwin: a digital twin for planning UAV pavement inspection over open traffic\n\n'
	@if [ -t 1 ]; then bold=$$'\033[1m' plain=$$'\033[0m'; fi; \
		awk -F ':.*## ' -v on="$$bold" -v off="$$plain" \
		'/^[a-z-]+:.*## / { printf "  %smake %-9s%s %s\n", on, $$1, off, $$2 }' $(MAKEFILE_LIST)
	@printf '\nEach sets up what it needs. Another Python: make PYTHON=python3.12 test\n\n'

setup:  ## Install everything into .venv, nothing else
	@scripts/setup.sh

demo: setup  ## A UAV inspects a generated town under traffic, with each of the four policies
	@.venv/bin/pavetwin demo

study: setup  ## The paper's study over a town without parking: 720 missions in a few minutes, and its report in out/study
	@test -d out/paper/town || .venv/bin/pavetwin world build --generate town --seed 1 --parking-rule none \
		--damage paper -o out/paper/town
	@test -f out/study.yaml || .venv/bin/pavetwin experiment init out/study.yaml --preset paper --world paper/town
	@.venv/bin/pavetwin experiment run out/study.yaml -o out/study
	@.venv/bin/pavetwin experiment report out/study --figures

pictures: demo study  ## The pictures of the documentation, made again (MISSION=FOLDER: those of plans, from it)
	@mkdir -p docs/images
	@cp out/demo/missions/comparison.png docs/images/comparison.png
	@cp out/demo/missions/hover/map.png docs/images/mission.png
	@cp out/study/figures/figure-1.svg docs/images/study.svg
	@.venv/bin/python -m gallery.aircraft
	@scripts/setup.sh browser
	@.venv/bin/python -m gallery.page
	@$(if $(MISSION),.venv/bin/python -m gallery.flight_plan $(MISSION),:)

gallery: setup  ## The images of docs/gallery, rendered again (MAPS=FOLDER: real streets too)
	@.venv/bin/python -m gallery $(if $(MAPS),--maps $(MAPS))

docs: setup .venv-docs/.done  ## The documentation as a site that opens offline: out/site/index.html
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/python -m mkdocs build --strict --quiet --site-dir out/site
	@echo "The documentation is in out/site/index.html"

.venv-docs/.done: docs/requirements.lock
	@$(PYTHON) -m venv --clear .venv-docs
	@.venv-docs/bin/pip install --quiet --require-hashes --requirement docs/requirements.lock
	@touch $@

assets: .venv-assets/.done  ## The models of the scene (src/pavetwin/scene/models), from Blender's Python module
	@PYTHONPATH=src .venv-assets/bin/python -m assets.build

.venv-assets/.done: assets/requirements.lock
	@$(PYTHON_ASSETS) -m venv --clear .venv-assets
	@.venv-assets/bin/pip install --quiet --require-hashes --requirement assets/requirements.lock
	@touch $@

vendor:  ## three.js and uPlot as one file (src/pavetwin/app/static/vendor.js), by esbuild; needs npm
	@assets/vendor/build.sh

test: setup  ## All tests but the slow ones
	@rc=0; cargo test --release --locked --quiet --package pavetwin-core || rc=1; $(PYTEST) || rc=1; exit $$rc

test-all: setup  ## All tests, the slow ones too, and with new random examples
	@scripts/setup.sh browser
	@rc=0; cargo test --release --locked --quiet --package pavetwin-core || rc=1; \
		$(PYTEST) -m '' --hypothesis-profile explore || rc=1; $(MAKE) --no-print-directory test-train || rc=1; exit $$rc

test-train: setup .venv-train/.done  ## The tests of the detector's training, with PyTorch in an environment of its own
	@PYTHONPATH=src .venv-train/bin/python -m pytest -n $(PYTEST_WORKERS) --dist loadfile -m '' tests/training tests/perception

.venv-train/.done: requirements-train.lock | setup
	@$(PYTHON) -m venv --clear .venv-train
	@.venv/bin/uv pip sync --no-config --quiet --require-hashes --python .venv-train/bin/python requirements-train.lock
	@touch $@

bench: setup  ## Measure the speed on this machine, beside the speed that is required
	@.venv/bin/python -m benchmarks
	@cargo bench --locked --package pavetwin-core --bench '*'

lint:  ## ruff, mypy --strict, clippy with warnings as errors, rustfmt
	@scripts/setup.sh packages
	@scripts/lint.sh

lock:  ## Write the lock files again from what is asked for (UPGRADE=1: the newest of everything)
	@scripts/setup.sh packages
	@.venv/bin/uv pip compile pyproject.toml --extra augment --extra detect --extra evaluate --group dev \
		--universal --python-version 3.11 \
		--generate-hashes --no-emit-index-url --no-header --quiet $(if $(UPGRADE),--upgrade) \
		--output-file requirements.lock
	@.venv/bin/uv pip compile pyproject.toml --all-extras --group dev \
		--constraint requirements.lock --universal --python-version 3.11 \
		--generate-hashes --no-emit-index-url --no-header --quiet $(if $(UPGRADE),--upgrade) \
		--output-file requirements-train.lock
	@.venv/bin/uv pip compile --group docs --universal --python-version 3.11 --generate-hashes \
		--no-emit-index-url --no-header --quiet $(if $(UPGRADE),--upgrade) --output-file docs/requirements.lock
	@cargo update --quiet $(if $(UPGRADE),,--workspace)
	@git diff --stat -- requirements.lock requirements-train.lock docs/requirements.lock Cargo.lock

clean:  ## Remove what these targets made, results in out/ excepted
	rm -rf .venv .venv-assets .venv-docs .venv-train .tools assets/vendor/node_modules target src/pavetwin/_core*.so
	rm -rf .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
