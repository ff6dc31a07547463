# `make run` and `make test` set up all they need. Python 3.11 or later, make and git must be there.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: run test test-all quick lint types imports unit coverage lowest docs gate bench soak reference tuning alignment ablation agents survey field paper-figures clean

## Compare funnel and flag on the task reach-stay; tables on screen and under results/.
run: $(VENV)/ready
	$(BIN)/stlbench run --methods funnel,flag --jobs 2

## Everything that CI checks.
test: lint types imports unit docs

## The same, and the slow tests: browser, notebooks, the site, whole studies. CI runs it every night.
test-all: lint types imports docs $(VENV)/ready-dev
	$(BIN)/python -m pytest -q -n auto --dist loadfile -m "not long" --durations 10

## The tests that take less than half a minute together, while you write.
QUICK := tests/stl tests/methods tests/task --ignore=tests/stl/recorded/test_rtamt.py \
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

docs: $(VENV)/ready-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

## Is anything worse than the committed reference? See docs/howto/share.md. Costs as well: make gate AGAINST=origin/main
AGAINST :=
gate: $(VENV)/ready
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

## All tasks x all methods x 10 seeds, and the tracks plain and tuned on six of the tasks: about 4 hours of CPU time; goes
## on where it was interrupted. The recipes of the track tuned are those of `make tuning`. See docs/reproduction.md.
reference: $(VENV)/ready-all
	$(BIN)/stlbench run studies/reference.yaml
	$(BIN)/stlbench run studies/reference-code.yaml
	$(BIN)/stlbench run studies/reference-ginf.yaml
	$(BIN)/stlbench run studies/tuned.yaml
	$(BIN)/stlbench run studies/plain.yaml
	$(BIN)/stlbench export results/reference --format jsonl
	$(BIN)/stlbench plot results/reference --rewarded

## A recipe for each method, 20 trials for each, on seeds that are not reported; 45 minutes of CPU time.
CHEAP := hold-disc,hold-disc-coarse,integrator-or,annulus,reach-stay,robot-nav
tuning: $(VENV)/ready-all
	$(BIN)/stlbench tune --tasks "$(CHEAP)" --methods funnel,flag,raw --trials 20 --results results/tuning

## What each reward asks for, by exact planning, beside what was learned; an hour and a half of CPU time. See
## docs/findings.md. Plans are made in results/alignment, and come into results/reference at the end.
ALIGN := PYTHONPATH=build/example $(BIN)/stlbench run --results results/alignment --seeds 0-0
GRIDS := integrator-or,hold-disc,hold-disc-coarse,annulus,robot-nav,reach-stay,pendulum,overlap
LESS := pendulum[without=rewarded],pendulum[without=cuts],overlap[without=rewarded],overlap[without=cuts]
PLAIN := pendulum[without=rewarded+cuts],overlap[without=rewarded+cuts]
alignment: $(VENV)/ready-all
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target build/example plugins/example
	$(ALIGN) --tasks "$(GRIDS)" --methods raw --agents "best-possible,best-possible[resolution=0.7]"
	$(ALIGN) --tasks "$(GRIDS)" --methods raw,funnel --agents "planner,planner[gamma=1],planner[resolution=0.7]"
	$(ALIGN) --tasks "$(LESS)" --methods raw,funnel --agents planner
	$(ALIGN) --tasks "$(PLAIN)" --methods raw,funnel --agents "planner,planner[gamma=1]"
	$(ALIGN) --tasks overlap --methods "funnel[t_star=0.7]" --agents planner
	$(ALIGN) --tasks "$(GRIDS)" --methods "funnel[shape=clipped],funnel[shape=normalised]" \
	--agents "planner,planner[gamma=1]"
	$(ALIGN) --tasks integrator-or,hold-disc,hold-disc-coarse --methods "funnel[variant=code],flag,verdict" \
	--agents "planner,planner[gamma=1]"
	$(ALIGN) --tasks annulus,reach-stay --methods flag,verdict --agents planner
	$(ALIGN) --tasks robot-nav,pendulum,overlap --methods flag,verdict --agents "planner[resolution=0.7]"
	rm -rf build/aligned
	$(BIN)/stlbench results merge build/aligned results/reference results/alignment
	cp -r results/reference/figures build/aligned/
	$(BIN)/stlbench report build/aligned
	$(BIN)/stlbench plot build/aligned --methods raw,funnel --tasks robot-nav,pendulum,overlap --only planned
	PYTHONPATH=build/example $(BIN)/python studies/returns.py build/aligned build/aligned/returns.csv
	$(BIN)/stlbench export build/aligned --format jsonl
	cp -r build/aligned/. results/reference

## What each part of each task's recipe is worth, 5 seeds of three methods; 8 hours of CPU time, goes on where it was
## interrupted. See docs/reproduction.md.
ablation: $(VENV)/ready-all
	$(BIN)/stlbench run studies/ablation.yaml
	$(BIN)/stlbench export results/ablation --format jsonl

## Every method on eight tasks, five seeds; the three cheapest also by a recipe for each method, 12 trials for each; and what
## each method asks for, by planning on a coarse grid. 2 hours of CPU time; goes on where it was interrupted. See
## docs/findings.md.
PLAN := $(BIN)/stlbench run --results results/survey-alignment --seeds 0-0
ROOMS := annulus,robot-nav,reach-stay
ALL := funnel,flag,raw,tau-mdp,sparse,bhnr,causation,hprs,tau-cmdp,cfer
RUNNING := tltl,dense,dense[mode=difference]
survey: $(VENV)/ready-all
	$(BIN)/stlbench run studies/survey.yaml
	$(BIN)/stlbench tune --tasks integrator-or,hold-disc-coarse,hold-disc --methods "$(ALL),$(RUNNING),machine" --trials 12 \
	  --results results/survey-tuning
	$(BIN)/stlbench run studies/survey-tuned.yaml
	$(PLAN) --tasks integrator-or,hold-disc-coarse,hold-disc --methods raw --agents best-possible
	$(PLAN) --tasks $(ROOMS) --methods raw --agents "best-possible[resolution=0.5]"
	$(PLAN) --tasks integrator-or,hold-disc-coarse --methods "$(ALL)" \
	  --agents "planner[resolution=0.5],planner[resolution=0.5,gamma=1]"
	$(PLAN) --tasks integrator-or --methods "$(RUNNING)" \
	  --agents "planner[resolution=0.5,rounded=33],planner[resolution=0.5,rounded=33,gamma=1]"
	$(PLAN) --tasks $(ROOMS),hold-disc --methods "$(ALL)" --agents "planner[resolution=0.5]"
	rm -rf build/survey
	$(BIN)/stlbench results merge build/survey results/survey results/survey-alignment
	$(BIN)/stlbench report build/survey
	$(BIN)/stlbench export build/survey --format jsonl
	cp build/survey/*.csv build/survey/report.md build/survey/cells.jsonl results/survey
	$(BIN)/python studies/survey.py
	$(BIN)/python studies/pages.py

## The tasks from the field, five seeds of three methods by two agents, and either-or by all; 3 hours of CPU time and half as
## much for lane, goes on where it was interrupted. See docs/reference/tasks.md, "What was learned".
WHOLE := tltl,dense[mode=difference]
OTHERS := dense,bhnr,tau-mdp,sparse,hprs,tau-cmdp,cfer,machine,causation
field: $(VENV)/ready-all
	$(BIN)/stlbench run studies/field.yaml
	$(BIN)/stlbench run --results results/field --tasks cartpole-steady,walker --methods tau-mdp --seeds 5
	$(BIN)/stlbench run --results results/field --tasks either-or --methods "$(WHOLE),$(OTHERS)" --seeds 5
	$(BIN)/stlbench run --results results/field --tasks either-or --methods "$(WHOLE)" --agents sb3-ppo --seeds 5
	$(BIN)/stlbench run studies/field-sb3.yaml
	$(BIN)/stlbench run studies/field-sb3-grid.yaml
	$(BIN)/stlbench export results/field --format jsonl
	$(BIN)/python studies/pages.py

## What the parts of the agents are worth, and other agents beside ours; half an hour of CPU time. See
## docs/reproduction.md.
AGENTS := $(BIN)/stlbench run --results results/agents --methods raw
agents: $(VENV)/ready-all
	$(AGENTS) --seeds 2 --tasks fetch-reach --agents "td3[averaging=0],sb3-td3,sb3-sac,sb3-ppo"
	$(AGENTS) --seeds 5 --tasks reach-stay,robot-nav --agents "\
	dqn[head=joint],dqn[averaging=0],dqn[n_steps=1],dqn[double=false]"
	$(AGENTS) --seeds 2 --tasks pendulum --agents "dqn[head=joint],dqn[averaging=0]"
	$(BIN)/stlbench report results/agents
	$(BIN)/stlbench export results/agents --format jsonl

## The subjects of the paper's figures, from one seed of each; 6 minutes of CPU time. See docs/reproduction.md.
PAPER := $(BIN)/stlbench run --results results/paper --seeds 1
paper-figures: $(VENV)/ready-all
	$(PAPER) --tasks pendulum,robot-nav,integrator-or,annulus,overlap,fetch-reach,cartpole,ball-in-cup --methods funnel
	$(PAPER) --tasks robot-nav --methods raw
	$(PAPER) --tasks hold-disc-coarse --methods flag,funnel
	$(BIN)/python studies/paper_figures.py results/paper

clean:
	rm -rf $(VENV) $(VENV)-lowest site dist build

$(VENV)/bin $(VENV)-lowest/bin:
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
