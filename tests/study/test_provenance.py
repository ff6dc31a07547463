"""What is noted beside a result."""

from __future__ import annotations

import platform
import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta

import numpy as np

from stlbench.study.provenance import collect


def test_names_versions_jobs_and_the_time():
    found = collect(3)
    assert found["python"] == platform.python_version()
    assert found["numpy"] == np.__version__
    assert found["jobs"] == "3"
    assert re.fullmatch(r"\w+ \w+, \d+ CPUs, \S.*", found["machine"])
    assert datetime.now(UTC) - datetime.fromisoformat(found["time"]) < timedelta(minutes=1)


def test_imports_none_of_the_packages_it_names():
    code = "import sys; from stlbench.study.provenance import collect; collect(1); "
    code += "print({'torch', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
