"""Command line of experiments that compute one row per index, in processes, and resume from a file of rows."""

import argparse
import json
from functools import partial
from pathlib import Path

from ftbias_jax.runtime.executors import run_each


def by_rows(one, doc, count, show=lambda row: row):
    """Compute the missing rows; return the seed of the command line and all rows in the order of their indices.

    Args:
        one: function (index, seed) -> row, a dict with its "index".
        doc: text of ``--help``.
        count: number of rows, unless ``--count`` is given.
        show: function that returns what is printed of a finished row.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--rows", type=Path, help="a file of rows, one a line: goes on where it ends")
    asked = parser.parse_args()
    kept = asked.rows.read_text().splitlines() if asked.rows and asked.rows.exists() else []
    rows = [json.loads(line) for line in kept]
    todo = sorted(set(range(asked.count)) - {row["index"] for row in rows})
    for _, row in run_each(partial(one, seed=asked.seed), todo, asked.jobs):
        print(show(row), flush=True)
        rows.append(row)
        if asked.rows:
            asked.rows.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return asked.seed, sorted(rows, key=lambda row: row["index"])
