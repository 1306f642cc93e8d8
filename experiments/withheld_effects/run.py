#!/usr/bin/env python3
"""Make a labelled set, diagnose it by both protocols and save the score: python run.py [FOLDER].

Logs and verdicts are kept in FOLDER, so that an interrupted run can be resumed.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.__main__ import main


def score(folder, out, jobs, *options):
    """Score the set of a folder; return the tables without the rows of single logs."""
    path = out / "score.json"
    command = ["score", str(folder), "--out", str(out), "--json", str(path), "--jobs", str(jobs), *options]
    if main(command) == 1:  # 3 is no failure: samples were left out, for example of a stuck axis
        raise SystemExit("a log has no diagnosis")
    content = json.loads(path.read_text())
    del content["rows"]
    return content


def run(folder, count, seed, jobs):
    """Score one set by both protocols."""
    logs = folder / f"seed_{seed}"
    if not (logs / "truth.json").exists() and main(
        ["make", str(logs), "--count", str(count), "--seed", str(seed), "--jobs", str(jobs)]
    ):
        raise SystemExit("no set was made")
    return {
        "seed": seed,
        "withheld": score(logs, folder / "verdicts", jobs),
        "leave_one_out": score(logs, folder / "verdicts_without", jobs, "--leave-one-out"),
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="for logs and verdicts (default: a temporary one)")
    parser.add_argument("--count", type=int, default=128)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        result = run(asked.folder or Path(temporary), asked.count, asked.seed, asked.jobs)
    from common import keep  # imported late, because it sets flags of JAX that the diagnosis should choose itself

    keep(__file__, result)
