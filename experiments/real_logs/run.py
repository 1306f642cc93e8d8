"""Recorded logs of three robots: predictions, error bars and contact, compared with a constant bias and a tare."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from cases import KUKA_RUNS, abb, folder, kuka, panda, with_least_squares_tool
from figure import draw
from predict import AHEAD, errors, inside, measured_bias, nis, past_of, prediction, rms, slow_and_fast

sys.path.append(str(Path(__file__).parents[1]))
import itertools

import by_hand
from common import keep, rounded

import ftbias_jax as ft
from ftbias_jax.calibration.tool.channels import find_channels, with_channels
from ftbias_jax.calibration.tool.steady import steady_bias
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.method.passes import GATE
from ftbias_jax.filtering.result import named_arrays

REST = 0.2
"""s at the end of the KUKA runs during which the arm is at rest."""
TARE = 0.5
"""s at the start over which a held tare is averaged."""
CALIBRATED = "gains and crosstalk of the training log, and its bias as prior"
CALIBRATED_TUNED = "the same, tuned on the training log"
IDENTIFIED = "identify --bias --crosstalk"
MOUNTED = "identify --bias --mounting"
OWN_WRENCH = (CALIBRATED, CALIBRATED_TUNED, IDENTIFIED, MOUNTED)
"""Candidates that are scored with their own wrench of the tool, which differs from that of the others."""
BLOCKS = 10


def study_kuka(real):
    """Compare the final bias with the reading at rest, in its standard deviations; list the contacts found."""
    scored, results = {}, {}
    for run in KUKA_RUNS:
        setup, log = kuka(real, run)
        result, stated = ft.filter_log(setup, log), ft.filter_log(setup, log, as_stated=True)
        at_rest = result.t > result.t[-1] - REST
        truth = np.nanmean(measured_bias(result)[at_rest], axis=0)
        scored[run] = {
            "measured bias at rest": rounded(truth),
            "default": at_the_end(result, truth),
            "with the accelerometer": at_the_end(ft.filter_log(*kuka(real, run, "specific_force")), truth),
            "as stated": at_the_end(stated, truth),
            "contacts [s]": [rounded([x.start, x.end]) for x in result.noise.contacts],
            "share used": rounded(result.used.mean()),
        }
        results[f"kuka {run}"] = result
    return scored, results


def at_the_end(result, truth):
    error, std = result.bias[-1] - truth, result.bias_std[-1]
    return {"error": rounded(error), "std": rounded(std), "error in std": rounded(error / std)}


def study_panda(real):
    """Score readings predicted 1 s and 10 s ahead on one log, with setups trained on another log."""
    setup = panda(real, 1)[0]
    logs = {number: panda(real, number)[1] for number in (1, 2, 3)}
    first = {number: ft.filter_log(setup, logs[number]) for number in (1, 2)}
    tools = {number: with_least_squares_tool(setup, result) for number, result in first.items()}
    scored, results = {}, {}
    for train, test in ((1, 2), (2, 1)):
        with_tool = tools[train]
        trained = ft.filter_log(with_tool, logs[train])
        result = ft.filter_log(with_tool, logs[test])
        constant = np.nanmean(measured_bias(trained), axis=0)
        prior = with_prior(with_tool, logs[train])
        channels = find_channels(with_tool, logs[train])
        calibrated = with_prior(with_channels(with_tool, channels), logs[train])
        identified = {
            IDENTIFIED: ft.identify_tool(setup, logs[train], bias=True, crosstalk=True),
            MOUNTED: ft.identify_tool(setup, logs[train], bias=True, mounting=True),
        }
        after, why = tuned(with_tool, logs[train])
        calibrated_after, calibrated_why = tuned(calibrated, logs[train])
        candidates = {
            "default": result,
            "default, drift not extrapolated": replace(result, drift=np.zeros_like(result.drift)),
            "as stated": ft.filter_log(with_tool, logs[test], as_stated=True),
            "default, prior of the training log": ft.filter_log(prior, logs[test]),
            "default, tuned on the training log": ft.filter_log(after, logs[test]),
            CALIBRATED: ft.filter_log(calibrated, logs[test]),
            CALIBRATED_TUNED: ft.filter_log(calibrated_after, logs[test]),
        } | {name: ft.filter_log(found.setup, logs[test]) for name, found in identified.items()}
        scored[f"trained on {train}, tested on {test}"] = {
            "tool": {"mass": rounded(with_tool.tool.mass), "center_of_mass": rounded(with_tool.tool.center_of_mass)},
            "constant": rounded(constant),
            "prior of the training log": {
                "initial": rounded(prior.bias.initial),
                "initial_std": rounded(prior.bias.initial_std),
                "initial_drift_std": rounded(prior.bias.initial_drift_std),
            },
            "gains and crosstalk": {
                "matrix": rounded(channels.matrix),
                "nats on blocks left out": rounded(channels.held_out),
            },
            "tune": why,
            "tune with gains and crosstalk": calibrated_why,
            "95 % intervals of forecasts": {
                f"{ahead:g} s": {
                    name: rounded(np.nanmean(inside(each, ahead)))
                    for name, each in candidates.items()
                    if each.reading_std is not None
                }
                for ahead in AHEAD
            },
            "share used": rounded(result.used.mean()),
        } | {f"{ahead:g} s": compare(result, candidates, constant, ahead) for ahead in AHEAD}
        results[f"panda {test}"] = result
    results["panda 3"] = ft.filter_log(tools[1], logs[3])
    return scored, results


def with_prior(setup, log):
    """Setup with the bias of a log as prior, as ``identify --bias`` writes it; the tool counts as known."""
    found = steady_bias(setup, log)
    prior = replace(setup.bias, initial=found.value, initial_std=found.std, initial_drift_std=found.drift_std)
    return replace(setup, bias=prior)


def compare(result, candidates, constant, ahead):
    """Rms errors (6,) of all candidates over the same samples, with the tool wrench of one result except OWN_WRENCH."""
    y = measured_bias(result)
    tare = np.nanmean(y[result.t < result.t[0] + TARE], axis=0)
    judged = np.where(np.isfinite(prediction(result, ahead)), y, np.nan)
    found = {
        name: rms(errors(each, ahead) if name in OWN_WRENCH else judged - prediction(each, ahead))
        for name, each in candidates.items()
    }
    baselines = {"constant calibration": rms(judged - constant), "held tare": rms(judged - tare)}
    hindsight = rms(judged - np.nanmean(judged, axis=0))
    so_far = np.nancumsum(y, axis=0) / np.maximum(np.isfinite(y).cumsum(0), 1)
    averaged = rms(judged - so_far[past_of(result.t, ahead)])
    own = rms(errors(candidates["as stated"], ahead))
    best = np.minimum(*baselines.values())
    return {
        "rms": {name: rounded(x) for name, x in (found | baselines).items()}
        | {"as stated, with its own wrench of the tool": rounded(own)}
        | {"mean of all readings so far": rounded(averaged), "their own mean, in hindsight": rounded(hindsight)},
        "over the better baseline, forces": {name: rounded((x / best)[:3]) for name, x in found.items()},
    }


def study_abb(real):
    """Score ten blocks, each filtered with noise fitted to the other nine; a filter has nothing else to fit."""
    setup, log = abb(real)
    result, stated = ft.filter_log(setup, log), ft.filter_log(setup, log, as_stated=True)
    options = ft.options_from_setup(setup)._replace(gate=GATE)
    params = params_for_log.max_likelihood_params(setup, ft.samples_from_log(log), options)
    whole_log = by_hand.Log(params, log)
    blocks = whole_log.blocks(options)
    edges = np.linspace(result.t[0], np.nextafter(result.t[-1], np.inf), BLOCKS + 1)
    ahead = AHEAD[0]
    unseen = np.full_like(result.bias, np.nan)
    squares = np.full_like(result.bias, np.nan)
    for low, high in itertools.pairwise(edges):
        seen = (blocks.t + log.start < low) | (blocks.t + log.start >= high)
        only = {name: np.where(seen[:, None], getattr(blocks, name), np.nan) for name in ("mean", "scatter")}
        others = blocks._replace(**only, count=np.where(seen[:, None], blocks.count, 0))
        fold, seen_params = whole_log.filtered(whole_log.noise(others), options)
        fold = replace(result, params=seen_params, **named_arrays(fold))
        rows = (fold.t >= low) & (fold.t < high)
        unseen[rows] = errors(fold, ahead)[rows]
        squares[rows] = (fold.innovation[rows] / fold.innovation_std[rows]) ** 2
    block = np.searchsorted(edges, result.t, side="right") - 1
    slow, fast = slow_and_fast(result)
    before, whole = errors(stated, ahead), errors(result, ahead)
    scored = {
        "1 s error, unseen blocks": rounded(rms(unseen)),
        "1 s error, noise of the whole log": rounded(rms(whole)),
        "1 s error, as stated": rounded(rms(before)),
        "unseen over as stated": rounded(rms(unseen) / rms(before)),
        "unseen over as stated, slowest tenth": rounded(rms(unseen[slow]) / rms(before[slow])),
        "1 s error, slowest tenth": {"unseen": rounded(rms(unseen[slow])), "as stated": rounded(rms(before[slow]))},
        "1 s error by block": [rounded(rms(unseen[block == i])) for i in range(BLOCKS)],
        "share used": rounded(result.used.mean()),
        "NIS": {
            name: {
                "unseen blocks": rounded(np.nanmean(squares[rows], axis=0)),
                "whole log": rounded(nis(result, rows)),
                "as stated": rounded(nis(stated, rows)),
            }
            for name, rows in (("slowest tenth", slow), ("fastest tenth", fast), ("all", slow | ~slow))
        },
    }
    return scored, {"abb": result}


def tuned(setup, log):
    """Tune a setup on a log; return the new setup, or the old one if tune fails, and the scores or the reasons."""
    try:
        found = ft.tune(setup, [log])
    except ft.FtbiasError as error:
        return setup, {"refused": str(error)}
    scores = {name: rounded([before, after]) for name, before, after, _ in found.held_out}
    return found.setup, {"refused": list(getattr(found, "reasons", ())), "held-out nats/s before and after": scores}


def study_tune(real):
    """Compare errors before and after ``tune`` on logs, or parts of logs, that it was not fitted to."""
    setup, log = abb(real)
    after, why = tuned(setup, log)
    results = [ft.filter_log(each, log) for each in (setup, after)]
    last = results[0].t > log.start + log.t[0] + 0.75 * (log.t[-1] - log.t[0])  # the part that tune holds out
    scored = {"abb, last quarter": before_and_after(results, last) | why}
    setup, log = kuka(real, "base")
    after, why = tuned(setup, log)
    results = [ft.filter_log(each, kuka(real, "vib")[1]) for each in (setup, after)]
    every = np.full(len(results[0].t), True)
    return scored | {"kuka, tuned on base, tested on vib": before_and_after(results, every) | why}


def before_and_after(results, rows):
    """Rms errors (6,) of results, for the horizons that fit into the log."""
    return {
        f"{ahead:g} s": [rounded(rms(errors(result, ahead)[rows])) for result in results]
        for ahead in AHEAD
        if np.isfinite(prediction(results[0], ahead)[rows]).any()
    }


def coverage(results):
    """Share of readings within their predicted 95 % intervals."""
    scored = {}
    for ahead in AHEAD:
        shares, counts = {}, {}
        for name, result in results.items():
            hits = inside(result, ahead)
            if np.isfinite(hits).any():
                shares[name], counts[name] = np.nanmean(hits, axis=0), np.isfinite(hits).sum()
        every = np.array(list(shares.values()))
        samples = sum(counts[name] * x.mean() for name, x in shares.items()) / sum(counts.values())
        scored[f"{ahead:g} s"] = {
            "by log and axis": {name: rounded(x) for name, x in shares.items()},
            "mean of logs and axes": rounded(every.mean()),
            "all samples": rounded(samples),
            "log and axis from 0.90 to 0.98": rounded(((every >= 0.9) & (every <= 0.98)).mean()),
        }
    return scored


def main():
    real = folder()
    if real is None:
        print("skipped: set FTBIAS_SHARED to the folder that has data/real with the recorded logs")
        return
    scored, results = {}, {}
    for name, study in (("kuka", study_kuka), ("abb", study_abb), ("panda", study_panda)):
        scored[name], found = study(real)
        results |= found
        print(name, scored[name], flush=True)
    scored["coverage"] = coverage(results)
    scored["tune"] = study_tune(real)
    keep(__file__, scored, draw(scored, results))


if __name__ == "__main__":
    main()
