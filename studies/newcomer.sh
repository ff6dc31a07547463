#!/usr/bin/env bash
# A newcomer's path, timed: from nothing to a first table with a reward method of one's own (docs/howto/method.md).
# Usage: studies/newcomer.sh FOLDER, which must not exist. It takes python3, or PYTHON, and the packages of constraints.txt.
set -euo pipefail
repository=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:?a folder that does not exist}
mkdir "$folder" && cd "$folder" && folder=$PWD
export PATH="$folder/venv/bin:$PATH" NUMBA_CACHE_DIR="$folder/numba" PIP_CONSTRAINT="$repository/constraints.txt"
unset PYTHONPATH
TIMEFORMAT="    %R s on the clock, %U s of a processor"

step() {
    echo "$*"
    time "$@" >>"$folder/log" 2>&1
}

"${PYTHON:-python3}" -m venv venv
step pip install "$repository"
step stlbench new method my-reward
cd my-reward
step pip install -e ".[dev]"
step stlbench check my-reward
step python -m pytest -q
step stlbench run --methods my-reward,raw,funnel --budget smoke
step stlbench run --methods my-reward,raw,funnel --budget smoke --results again
wc -l src/*/*.py pyproject.toml tests/*.py README.md
