"""The README tells how many faults are tested."""

import re
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
README = HERE.parents[1] / "README.md"


def test_the_count_in_the_readme_is_that_of_the_tests():
    command = [
        sys.executable,
        "-m",
        "pytest",
        "--collect-only",
        "-q",
        "-o",
        "addopts=--import-mode=importlib",
        str(HERE),
    ]
    listed = subprocess.run(command, cwd=HERE.parents[1], capture_output=True, text=True, check=True).stdout
    cases = [line for line in listed.splitlines() if "::test_" in line and "test_count.py" not in line]
    (told,) = re.findall(r"(\d+) cases in `tests/faults`", README.read_text())
    assert len(cases) == int(told)
