#!/usr/bin/env python3
"""Make pairs of logs with effects outside the catalogue, diagnose the first of each and score: python run.py [FOLDER].

Logs and verdicts are kept in FOLDER, so that an interrupted run can be resumed.
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from validation.__main__ import main


def run(folder, kinds, count, seed, jobs):
    """Score of a subset of the kinds of effects, without the rows of single logs."""
    logs = folder / f"{kinds}_{seed}"
    make = ["--protocol", "unlisted", "--kinds", kinds, "--count", str(count), "--seed", str(seed)]
    if not (logs / "truth.json").exists() and main(["make", str(logs), *make, "--jobs", str(jobs)]):
        raise SystemExit("no set was made")
    path = logs / "verdicts" / "score.json"
    if main(["score", str(logs), "--json", str(path), "--jobs", str(jobs)]) == 1:
        print("some logs have no diagnosis: they count as wrong", file=sys.stderr)
    content = json.loads(path.read_text())
    found = content["unlisted_kinds"]
    del found["rows"]
    return {"seed": seed, "kinds": kinds, "logs": content["logs"], "seconds": content["seconds"], **found}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, help="for logs and verdicts (default: a temporary one)")
    parser.add_argument("--kinds", choices=("seen", "unseen", "all", "events"), default="all")
    parser.add_argument("--count", type=int, default=56)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        result = run(asked.folder or Path(temporary), asked.kinds, asked.count, asked.seed, asked.jobs)
    from common import keep  # imported late, because it sets flags of JAX that the diagnosis should choose itself

    keep(__file__, result, name="events" if asked.kinds == "events" else "result")
