# Every target creates .venv if needed; only python3 (3.11 or newer) and make are required.
PYTHON ?= python3
ARGS ?=
BIN := .venv/bin
NPM := PATH="$(CURDIR)/.venv-node/bin:$$PATH" npm --prefix api/console

# Python's bytecode is always kept: pytest's rewriting of modules takes longer than many tests.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: sitl ready demo quick units test soak checked computed flown console console-test schema tested-with check compiled bench mutate flight-quality gallery race screenshots docs notebook format lock lowest clean

# Two environments are made in parallel: one for flying, one for building the console.
ready:
	@$(MAKE) --no-print-directory -j2 .venv/ready console

demo: ready  ## fly the whole story with the fake fleet; ARGS="--vehicles 8 --seconds 240 --json"
	@$(BIN)/gcs demo $(ARGS)

# What computes is a little nice, so that real-time flights are not late. With 10 it would get a tenth of a core beside
# two other busy processes, and nothing at idle priority.
NICE := nice -n 1

test: ready  ## lint, types, import contracts, every test: what computes beside what flies in real time
	@$(MAKE) --no-print-directory -j3 --output-sync=target checked computed flown
	@$(BIN)/python -m tests.support.browsers  # its last line says when the console was not tested

checked: .venv/ready console
	@$(NICE) $(MAKE) --no-print-directory check console-test

IN_CHECK := $(addprefix unit/test_,project_files.py packages.py decisions.py)

# Folders without a test that computes are not collected (conftest.py refuses one there), nor is a plugin loaded
# that only a soak test needs. In the order of the folders, flights first, the short tests fill what is left.
COMPUTING = -m "not realtime and $(if $(SOAK),,not) soak" -p no:schemathesis -n 0 --forks 8 \
  $(addprefix --ignore=tests/,browser integration unit/api unit/recording $(IN_CHECK))

computed: .venv/ready console compiled
	$(NICE) $(BIN)/pytest $(COMPUTING) --timeout 1800  # it may wait long for its turn

# Long files first, the show flown by the page before all; the many short ones fill what is left at the end. Four at
# once: most of the time they wait.
FLOWN := -o cache_dir=.pytest_cache/flown -m "realtime and not soak" -p no:schemathesis -n 0 \
  $(addprefix tests/,browser system integration unit/api unit/recording)

# A real-time test fails when it fails twice, the second time alone, with fixtures of its own. A real defect ends
# the second run at once. docs/testing.md
flown: .venv/ready console compiled
	@rm -rf .pytest_cache/flown
	$(BIN)/pytest $(FLOWN) --forks 4 || { [ $$? = 1 ] && echo "Again, one by one:" && \
	  $(BIN)/pytest $(FLOWN) --again --exitfirst; }

soak: ready compiled  ## what a week needs: all variants, twenty kills, long floods, the whole demo, ten times the examples
	$(MAKE) --no-print-directory computed SOAK=1
	$(BIN)/pytest -m "realtime and soak" -n 0 --timeout 1800 tests
	$(BIN)/pytest -m hypothesis --hypothesis-profile=soak -n 0 --timeout 1800 tests

quick: .venv/ready compiled  ## between edits, in 90 s: linters, types, contracts, short units, properties, two files of flights
	@$(MAKE) --no-print-directory -j2 --output-sync=target check units

units: .venv/ready
	$(BIN)/pytest $(COMPUTING) -m "not soak and not long" \
	  $(addprefix tests/,unit properties flight/test_show_flight.py flight/test_group_commands.py)

console: api/console/dist/index.html  ## the operator's page, built by Node from a wheel of its own

console-test: .venv/ready api/console/node_modules/ready  ## the page's types and unit tests
	$(BIN)/python -m gcs.api.app | $(NPM) run --silent schema -- --check --output src/schemas/schema.ts || \
	  { echo "api/console/src/schemas/schema.ts is not what the API says of itself: make schema" >&2; exit 1; }
	$(NPM) run --silent types
	$(NPM) run --silent cycles
	$(NPM) run --silent test

schema: .venv/ready api/console/node_modules/ready  ## the console's types, from the API's OpenAPI document
	$(BIN)/python -m gcs.api.app | $(NPM) run --silent schema -- --output src/schemas/schema.ts

tested-with: .venv/ready  ## docs/reference/tested-with.md, from the tables of versions
	$(BIN)/python -m gcs.links.autopilots.versions.page > docs/reference/tested-with.md

compiled: .venv/ready  ## the law as machine code, so that no flight waits for the compiler
	@$(BIN)/python -m tests.support.machine_code

check: .venv/ready  ## vocabulary, ruff, mypy, import contracts, the project's own files
	$(BIN)/python -m tests.vocabulary
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/pytest -n 0 $(addprefix tests/,$(IN_CHECK))

bench: .venv/ready  ## speed, as ratios against a named alternative in the same run
	$(BIN)/python -m tests.bench.run
	$(BIN)/python -m tests.bench.crossings
	$(BIN)/python -m tests.bench.site_rows
	$(BIN)/python -m tests.bench.links
	$(BIN)/python -m tests.bench.flood
	$(BIN)/python -m tests.bench.viewers
	$(BIN)/python -m tests.bench.page
	$(BIN)/python -m tests.bench.lights
	$(BIN)/python -m tests.bench.corrections
	$(BIN)/python -m tests.bench.drawings
	$(BIN)/python -m tests.bench.stations
	$(BIN)/python -m tests.bench.busy

mutate: .venv/mutate  ## break gcs/safety on purpose, on copies; ARGS="gcs/safety/walls.py", ARGS=--again
	$(BIN)/python -m tests.mutate.mutate $(ARGS)

flight-quality: .venv/ready  ## fly every scenario as it is judged; brings docs/flight-quality.md up to date
	@mkdir -p runs
	-$(BIN)/gcs simulate --all --json > runs/flight-quality.jsonl
	$(BIN)/python -m tests.bench.flight_quality runs/flight-quality.jsonl docs/flight-quality.md

gallery: .venv/ready  ## docs/gallery.md, a picture of one flight of every scenario, and the README's moving one
	$(BIN)/python -m tests.bench.gallery $(ARGS)

race: .venv/ready build/crazyflow/ready  ## docs/race.md: the same flights by published methods and by ours
	$(BIN)/python -m tests.bench.race.race $(ARGS)

screenshots: .venv/ready console  ## docs/screenshots, of a flight over the fake fleet; needs Chromium; look at them
	$(BIN)/python -m tests.browser.screenshots
	$(BIN)/python -m tests.browser.status_pictures

# PX4= or ARDUPILOT=a tree, a build or the program; PX4_IMAGE=container image that runs PX4's SIH; FAKE=1 with AUTOPILOT=
# px4, ardupilot or mixed, VERSION= and SEED=. Without any of them it is looked for. TRANSPORT=, STORY=, STATIONS=, VEHICLES=4
SITL = $(if $(PX4),--px4 "$(PX4)",$(if $(PX4_IMAGE),--image "$(PX4_IMAGE)",$(if $(ARDUPILOT),--arducopter "$(ARDUPILOT)",$(if $(FAKE),--fake)))) \
  $(foreach option,autopilot $(if $(FAKE),version seed) transport story stations,$(if $($(call upper,$(option))),--$(option) $($(call upper,$(option)))))
upper = $(shell echo $(1) | tr a-z A-Z)
sitl: .venv/ready  ## a story with real autopilots: PX4=PATH, PX4_IMAGE=IMAGE, ARDUPILOT=PATH, FAKE=1, or what is found; docs/sitl.md
	$(BIN)/python -m tests.sitl.fly $(SITL) --vehicles $(or $(VEHICLES),4) $(ARGS)

docs: .venv/docs  ## the documentation site in build/site, strictly; no network; decision 0032
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet  # the variable hides an announcement of the theme
	$(BIN)/pytest -n 0 docs/site
	@echo "build/site/index.html"

notebook: .venv/docs  ## run docs/examples/my_law.ipynb, and store what its cells print and draw
	$(BIN)/python docs/site/notebook.py

format: .venv/ready
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lock:  ## needs uv on the PATH; names no registry host
	uv pip compile --quiet --generate-hashes --universal --python-version 3.11 --no-header \
	  --extra dev --output-file requirements.lock pyproject.toml
	uv pip compile --quiet --generate-hashes --universal --python-version 3.11 --no-header \
	  --constraint requirements.lock --group mutate --output-file requirements-mutate.lock
	uv pip compile --quiet --generate-hashes --universal --python-version 3.11 --no-header \
	  --constraint requirements.lock --group docs --output-file requirements-docs.lock
	uv pip compile --quiet --generate-hashes --universal --python-version 3.11 --no-header \
	  --group node --output-file requirements-node.lock

lowest:  ## import every module with the oldest versions that pyproject.toml permits; needs uv on the PATH
	uv venv --quiet --clear --python 3.11 .venv-lowest
	uv pip install --quiet --python .venv-lowest --resolution lowest-direct --extra plots --extra stations -r pyproject.toml
	.venv-lowest/bin/python -m tests.support.every_module

clean:
	rm -rf .venv .venv-node .venv-lowest build dist api/console/dist api/console/node_modules

.venv/ready: pyproject.toml .venv/locked
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

.venv/mutate: .venv/ready requirements-mutate.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements-mutate.lock
	@touch $@

.venv/docs: .venv/ready requirements-docs.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements-docs.lock
	@touch $@

.venv/locked: requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Python 3.11 or newer is needed; $(PYTHON) is `$(PYTHON) --version`. Try: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || \
	  { echo "python3's venv module is missing; on Debian and Ubuntu: apt install python3-venv" >&2; exit 1; }
	@test ! -L .venv || { echo ".venv is a link: it is made where it points to, not emptied from here" >&2; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes --no-compile -r requirements.lock
	@$(BIN)/python -m compileall -qq -j 0 .venv/lib || true  # on all cores; errors are ignored, as in pip
	@touch $@

# 1.2 GB for one model of a vehicle in the race: in no environment of the project. Without it its rows are not flown.
build/crazyflow/ready:
	@$(BIN)/pip install --quiet --disable-pip-version-check --target build/crazyflow crazyflow==0.4.0 && touch $@ || \
	  echo "crazyflow cannot be installed here: the race is flown without it" >&2

.venv-node/ready: requirements-node.lock  # 200 MB, only for building: not part of the runtime environment
	$(PYTHON) -m venv --clear .venv-node
	.venv-node/bin/pip install --quiet --disable-pip-version-check --require-hashes -r requirements-node.lock
	@touch $@

api/console/node_modules/ready: .venv-node/ready api/console/package.json api/console/package-lock.json api/console/.npmrc
	$(NPM) ci --silent
	@touch $@

api/console/dist/index.html: api/console/node_modules/ready $(shell find api/console/src -type f) \
  api/console/index.html api/console/docs.html api/console/vite.config.ts api/console/compress.ts
	$(NPM) run --silent build -- --logLevel warn
	@touch $@
