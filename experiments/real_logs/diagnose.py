"""Diagnosis of recorded logs: verdict, causes and terms, held-out evidence, and the remaining gap."""

import argparse
import json
import os
import sys
import time
from pathlib import Path

import ftbias_jax as ft
from ftbias_jax.diagnosis.report.as_json import to_json

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "mistakes")]
from common import versions  # noqa: E402
from recorded import recorded_logs  # noqa: E402

PATH = Path(__file__).with_name("diagnosis.json")


def diagnosed(tables, arrays):
    """Diagnose one log; return the main entries of its report."""
    setup = ft.parse_setup(tables)
    start = time.process_time()
    whole = to_json(ft.diagnose(setup, [ft.Log.from_arrays(setup, **{"q": None, **arrays})]))
    kept = ("effect", "held_out_gain", "held_out_gain_stderr", "shrink", "doubt", "indistinguishable_from")
    causes = [{key: cause[key] for key in kept} | {"parameters": cause["parameters"]} for cause in whole["causes"]]
    names = ("verdict", "sentence", "terms", "gap", "not_tested")
    return {name: whole[name] for name in names} | {"causes": causes, "cpu_s": round(time.process_time() - start, 1)}


def row(name, found):
    """Format a line of the table in README.md."""
    causes = [f"{c['effect']} ({c['held_out_gain']:.3g} ± {c['held_out_gain_stderr']:.2g})" for c in found["causes"]]
    drives = [f"{t['drive']} ({t['held_out_gain']:.3g} ± {t['held_out_gain_stderr']:.2g})" for t in found["terms"]]
    before, after = (found["gap"][when]["in_noise_sigmas"] for when in ("before", "after"))
    shrink = f"{found['gap']['shrink']:.2f}"
    columns = [name, found["verdict"], ", ".join(causes) or "-", ", ".join(drives) or "-", f"{before:.2f}"]
    return f"| {' | '.join([*columns, f'{after:.2f}', shrink])} |"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", nargs="+", default=[""], help="parts of the names of the logs to diagnose")
    parser.add_argument("--table", action="store_true", help="only print the table of README.md")
    arguments = parser.parse_args()
    result = json.loads(PATH.read_text())["result"] if PATH.exists() else {}
    logs = [] if arguments.table else recorded_logs()
    if not logs and not arguments.table:
        print("skipped: FTBIAS_SHARED names no folder with recorded logs")
    for name, tables, arrays, expected in logs:
        if expected == ["none"] and any(part in name for part in arguments.only):
            result[name] = diagnosed(tables, arrays)
            print(name, result[name]["sentence"], flush=True)
            PATH.write_text(json.dumps({"versions": versions(), "result": result}, indent=1) + "\n")
    print("| log | verdict | causes (nats/s) | terms (nats/s) | before | after | shrink |", "|" + "---|" * 7, sep="\n")
    print(*(row(name, found) for name, found in result.items()), sep="\n")


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
