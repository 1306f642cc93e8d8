"""Vibration of the recorded ABB arm: the cause that diagnose names, the fit by tune, and the NIS with each setup."""

import json
import sys
from dataclasses import replace
from pathlib import Path

sys.path.extend([str(Path(__file__).parents[1]), str(Path(__file__).parent)])
from cases import abb, folder
from common import rounded, versions
from predict import nis, slow_and_fast

import ftbias_jax as ft

PATH = Path(__file__).with_name("vibration.json")


def squares(setup, log):
    """NIS (6,) by axis in the slowest and the fastest tenth, by the default filter and with the noise as stated."""
    found = {}
    for name, as_stated in (("default", False), ("as stated", True)):
        result = ft.filter_log(setup, log, as_stated=as_stated)
        slow, fast = slow_and_fast(result)
        found[name] = {"slowest tenth": rounded(nis(result, slow)), "fastest tenth": rounded(nis(result, fast))}
    return found


def main():
    real = folder()
    if real is None:
        print("skipped: set FTBIAS_SHARED to the folder that has data/real with the recorded logs")
        return
    setup, log = abb(real)
    diagnosis = ft.diagnose(setup, [log])
    applied = diagnosis.apply(setup)
    cause = diagnosis.causes[0]
    square = {name: x for name, x in applied.effects["vibration"].items() if name != "speed"}
    tuned = ft.tune(setup, [log])
    setups = {
        "before": setup,
        "diagnosis applied": applied,
        "the same weights without a speed": replace(applied, effects={**applied.effects, "vibration": square}),
        "tuned": tuned.setup,
    }
    scored = {
        "cause": cause.effect,
        "nats/s held out": rounded([cause.held_out_gain, cause.held_out_gain_stderr]),
        "speed [rad/s]": rounded([cause.parameters["speed"], cause.stderr["speed"]]),
        "tuned speed [rad/s]": rounded(tuned.setup.effects["vibration"]["speed"]),
        "tune, held-out wrench score, nats/s": rounded(tuned.held_out[-1][1:]),
        "tune, reasons against": list(tuned.reasons),
        "NIS": {name: squares(each, log) for name, each in setups.items()},
    }
    print(json.dumps(scored, indent=1))
    PATH.write_text(json.dumps({"versions": versions(), "result": scored}, indent=1) + "\n")


if __name__ == "__main__":
    main()
