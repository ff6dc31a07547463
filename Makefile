# `make run` and `make test` set up all they need. Python 3.11 or later, make and git must be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: run test test-all quick lint types imports unit coverage lowest audit docs gate bench soak reproduce clean

## Compare funnel and flag on the task reach-stay; tables on screen and under results/.
run: $(VENV)/ready
	$(BIN)/stlbench run --methods funnel,flag --jobs 2

## Everything that CI checks.
test: lint types imports unit docs

## The same, and the slow tests: browser, notebooks, the site, whole studies. CI runs it every night.
test-all: lint types imports docs $(VENV)/ready-dev
	$(BIN)/python -m pytest -q -n auto --dist loadfile -m "not long" --durations 10 --hypothesis-profile night

## The tests that take less than half a minute together, while you write.
QUICK := tests/arithmetic tests/stl tests/methods tests/task --ignore=tests/stl/recorded/test_rtamt.py \
	--ignore=tests/stl/language/test_limits.py --ignore=tests/stl/boxes --ignore=tests/stl/predicates/test_compiler.py
quick: $(VENV)/ready-dev
	$(BIN)/python -m pytest -q -n auto --dist worksteal $(QUICK)

lint: $(VENV)/ready-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/ready-dev
	$(BIN)/mypy

imports: $(VENV)/ready-dev
	$(BIN)/lint-imports --no-cache

unit: $(VENV)/ready-dev
	$(BIN)/python -m pytest -q -n auto --dist loadfile --durations 10

## The unit tests, with the share of lines and branches that they reach; also as coverage.xml.
coverage: $(VENV)/ready-dev
	$(BIN)/python -m pytest -q -n auto --dist loadfile --cov --cov-report term --cov-report xml

## The unit tests with the lowest versions that pyproject.toml allows, in a virtual environment of their own.
lowest: LOW := $(VENV)-lowest
lowest: | $(VENV)-lowest/bin
	$(LOW)/bin/python -m pip install --quiet uv
	$(LOW)/bin/uv pip install --quiet --python $(LOW)/bin/python --resolution lowest-direct -e '.[dev]'
	$(LOW)/bin/python -m pytest -q -n auto --dist loadfile

## Known holes in what is pinned, and in the lowest versions that pyproject.toml allows. Databases are asked for them.
audit: AUDIT := $(VENV)-audit
audit: | $(VENV)-audit/bin
	$(AUDIT)/bin/python -m pip install --quiet pip-audit uv
	$(AUDIT)/bin/uv pip compile --quiet --resolution lowest-direct --extra dev pyproject.toml -o $(AUDIT)/lowest.txt
	$(AUDIT)/bin/pip-audit --no-deps --disable-pip -r constraints.txt
	$(AUDIT)/bin/pip-audit --no-deps --disable-pip -r $(AUDIT)/lowest.txt

docs: $(VENV)/ready-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

## Is anything worse than the committed reference? See docs/howto/share.md. Costs as well: make gate AGAINST=origin/main
# Results of before go: the key of a cell does not notice a change of built-in code without a new revision.
AGAINST :=
gate: $(VENV)/ready
	rm -rf results/gate
	$(BIN)/stlbench gate results/gate-reference --budget smoke $(if $(AGAINST),--against $(AGAINST))

## Speed beside peers, by turns in one run; an hour. Writes results/bench.json and docs/performance-tables.md.
## Only a part; other figures stay: make bench PARTS=tests/benchmarks/test_monitor.py
PARTS := tests/benchmarks
bench: $(VENV)/ready-bench
	@mkdir -p results
	$(BIN)/python -m pytest $(PARTS) --benchmark-only -q --benchmark-json=results/benchmarks.json
	$(BIN)/python tests/benchmarks/collect.py results/benchmarks.json $(if $(filter-out tests/benchmarks,$(PARTS)),--merge)

## What takes too long for each change: 10,000 cells of which 500 misbehave, in a run that is killed 50 times, and damaged
## input of all kinds; some hours. The first goes on where it was interrupted: make soak SOAK="--cells 2000 --kills 10"
SOAK :=
soak: $(VENV)/ready-dev
	$(BIN)/python tests/long/soak.py --folder build/soak $(SOAK)
	$(BIN)/python -m pytest -q -n auto -m long

## Train again what a table or a figure is made of: make reproduce TABLE=1. Without TABLE it lists what there is, and CPU
## time. See docs/reproduction.md.
TABLE :=
reproduce:
	@VENV=$(VENV) $(PYTHON) studies/reproduce.py $(TABLE)

clean:
	rm -rf $(VENV) $(VENV)-lowest $(VENV)-audit site dist build

$(VENV)/bin $(VENV)-lowest/bin $(VENV)-audit/bin:
	@command -v $(PYTHON) > /dev/null || \
	  { echo "no $(PYTHON) here; stlbench needs Python 3.11 or later: make PYTHON=python3.12 ..."; exit 2; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "$(PYTHON) is older than Python 3.11, which stlbench needs: make PYTHON=python3.12 ..."; exit 2; }
	$(PYTHON) -m venv $(@D)

$(VENV)/ready: pyproject.toml constraints.txt | $(VENV)/bin
	$(BIN)/python -m pip install --quiet -c constraints.txt -e .
	@touch $@

# On Python 3.13 dm_control has to be installed without its dependencies, see pyproject.toml; elsewhere it is there by then.
$(VENV)/ready-%: pyproject.toml constraints.txt | $(VENV)/bin
	$(BIN)/python -m pip install --quiet -c constraints.txt -e '.[$*]'
	$(BIN)/python -m pip install --quiet -c constraints.txt --no-deps dm_control
	@touch $@ $(VENV)/ready
