"""Public function ``tune``: a setup with the maximum-likelihood noise of logs, compared on held-out data."""

from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import chain

import jax
import numpy as np

from ftbias_jax.calibration import judgement, newton
from ftbias_jax.calibration.noise.fit import Tool, tune_data
from ftbias_jax.calibration.noise.values import JOINT_NAMES, KINDS, TIES, values_from_setup
from ftbias_jax.calibration.tune import Fit, tune_joints, tune_wrench
from ftbias_jax.calibration.tune_blocks import LogInBlocks, held_out_blocks, is_correlated, look_at_each, tune_in_blocks
from ftbias_jax.calibration.tune_levels import no_less_than_scatter, start_from_observed_level
from ftbias_jax.calibration.tune_motion import shown_vibration, tune_motion
from ftbias_jax.calibration.tune_result import TuneResult, comments_of, is_better, reasons_against, with_fit, with_noise
from ftbias_jax.check.check_setup import require_right
from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import arrays_from_log
from ftbias_jax.io import GivenLog, as_logs
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup import GivenSetup, Setup, as_setup
from ftbias_jax.setup.require import require_one_robot
from ftbias_jax.types import Sample

FIT = ("joints", "bias", "sensor", "data")
"""What can be fitted: joint noise, sigma_Q, sensor noise, and Sigma_D if it is asked for."""
FIT_BY_DEFAULT = FIT[:3]

ReportFit = Callable[[str, int, float], None]
"""Callback with ("joints", "pose" or "wrench", iteration, nats)."""


def _nobody(label: str, iteration: int, value: float) -> None:
    """Ignore progress."""


@in_float64
def tune(
    setup: GivenSetup,
    logs: GivenLog | Iterable[GivenLog],
    *,
    fit: Collection[str] = FIT_BY_DEFAULT,
    tie: str = "each",
    data_noise: str = "one",
    others: Sequence[tuple[GivenSetup, Iterable[GivenLog]]] = (),
    restarts: int = 1,
    hold_out: float = 0.25,
    start: Log | None = None,
    report: ReportFit = _nobody,
    total: newton.Total = newton.alone,
    unchecked: bool = False,
    effects: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> TuneResult:
    """Fit the noise of joints, bias and sensor to logs by maximum likelihood.

    Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's cache folder
    (``FTBIAS_CACHE=off`` disables it).

    Args:
        setup: setup with robot, sensor, tool, and noise to start from, or its path.
        logs: logs of one robot and sensor, as returned by ``read_log``, or their paths.
        fit: some of FIT; with "data" the noise of bias, sensor and motion is fitted together, by its gradient.
        tie: whether sigma_Q and the sensor's noise have a value for "each" axis, for a "pair" of forces and torques, or
            "one" for all.
        data_noise: what to fit of Sigma_D: "one" number for each of its four parts, "three" for the axes of the sensor,
            or all "entries" of D.
        others: setups of further tools on this robot and sensor, and their logs: they separate the noise of the sensor
            from that of the motion.
        restarts: number of further starts, all values off by random factors, to see whether they agree.
        hold_out: share at the end of every log that is held out for the comparison, 0 to 0.9.
        start: log whose likeliest joint noise is the start; None = the first one.
        report: called after every iteration.
        total: sums over the processes that tune together, as ``distributed.total`` does.
        unchecked: skip the check whether the setups can be right (``check_setup``).
        effects: your own effects that the setups state.
        executor: executor whose workers process parts of the logs at every step of the fits, as for ``filter_log``; the
            parts are sent to them each time. None = up to four threads do.

    Raises:
        UsageError: no log, or an invalid name or share.
        SetupError: a further setup differs in more than its tool and the prior of its bias; or the logs show that a
            setup is wrong. LogError: the logs are in units or frames that no setup states.
    """
    given = [(as_setup(each, effects), its_logs) for each, its_logs in ((setup, logs), *others)]
    tools = [(each, as_logs(its_logs, each)) for each, its_logs in given]
    setup, logs = tools[0]
    _check(tools, fit, tie, data_noise, hold_out, total)
    for each, its_logs in tools:
        require_right(each, its_logs, "tune", unchecked)
    options = Options(joint_model=setup.joints.model)
    # Only from the fitted part: a setup that had seen the rest could not be improved on there.
    seen_first = _part(arrays_from_log(start or logs[0]), 0, 1 - hold_out)
    first = params_for_log.max_likelihood_params(setup, seen_first, options)
    stated = [first, *(params_from_setup(other)._replace(joint=first.joint) for other, _ in tools[1:])]
    samples = [
        [params_for_log.useful_samples(log, params) for log in logs_of_tool]
        for params, (_, logs_of_tool) in zip(stated, tools, strict=True)
    ]
    seen = [[_part(log, 0, 1 - hold_out) for log in logs_of_tool] for logs_of_tool in samples]
    fits: dict[str, Fit] = {}
    # The wrench needs the likeliest process noise of the joints, even if their noise is not to be fitted.
    names = JOINT_NAMES if "joints" in fit else JOINT_NAMES[:1]
    search = newton.Search(restarts, partial(report, "joints" if setup.pose is None else "pose"), total, executor)
    params, joints = tune_joints(first, list(chain(*seen)), dict.fromkeys(names, "each"), options, search)
    if "joints" in fit:
        fits["joints"] = joints
    tuned = [before._replace(joint=params.joint) for before in stated]
    ties = {"density": "bias", "wrench_std": "sensor"}
    wanted = {name: tie for name, part in ties.items() if part in fit}
    report_wrench = partial(report, "wrench")
    search = search._replace(report=report_wrench)
    alone, in_blocks, written = total is newton.alone, list[LogInBlocks](), [each for each, _ in tools]
    if "data" in fit:
        parts = [Tool(*x) for x in zip(tuned, seen, strict=True)]
        start_values = values_from_setup(setup)
        everything = KINDS[data_noise] | wanted
        tuned, fits["wrench"] = tune_data(parts, everything, start_values, options, search)
    elif wanted:
        counts = [max(1, round((1 - hold_out) * len(log.t))) for log in logs]
        fitted_part = [log._replace(**params_for_log.rows_of(log, 0, n)) for log, n in zip(logs, counts, strict=True)]
        if alone:
            tuned = [start_from_observed_level(tuned[0], fitted_part, wanted, options)]
            in_blocks = look_at_each(tuned[0], fitted_part, options)
            if "density" in wanted:  # written on axes that the logs leave open
                level = np.asarray(tuned[0].bias.density, float)
                written = [replace(setup, bias=replace(setup.bias, noise_density=level))]
        if is_correlated(in_blocks):
            params, found = tune_in_blocks(tuned[0], in_blocks, tie, list(wanted), report_wrench)
            fits |= found
        else:
            params, fits["wrench"] = tune_wrench(tuned[0], seen[0], wanted, options, search)
        if alone and "wrench" in fits:
            params, fits["wrench"] = no_less_than_scatter(params, fits["wrench"], fitted_part)
        tuned = [params]
    unseen = [[_part(log, 1 - hold_out, 1) for log in logs_of_tool] for logs_of_tool in samples] if hold_out else []
    shown, correlated = judgement.what_the_logs_show([log.noise for log in in_blocks], logs), is_correlated(in_blocks)
    candidates = [(tuned, fits)]
    vibration = shown_vibration(in_blocks)
    if vibration is not None and "sensor" in fit and hold_out:
        # With correlated errors the sample-wise likelihood cannot identify the density of the bias's random walk.
        beside = {} if correlated else wanted
        params, of_motion = tune_motion(tuned[0], seen[0], vibration, beside, options, report_wrench)
        params, of_motion = no_less_than_scatter(params, of_motion, fitted_part)
        candidates.append(([params], {**fits, "wrench": with_fit(fits.get("wrench"), of_motion)}))
    setups = [
        [
            replace(with_noise(each, params, found), comments={**each.comments, **comments_of(found)})
            for each, params in zip(written, tuned, strict=True)
        ]
        for tuned, found in candidates
    ]
    scores: Sequence[tuple[judgement.HeldOut, ...]] = [()] * len(candidates)
    predicted: list[tuple[judgement.Predicted, ...]] = [()] * len(candidates)
    if hold_out:
        scores = judgement.held_out_samples(stated, [tuned for tuned, _ in candidates], unseen, options, total)
    if hold_out and correlated:
        whole = look_at_each(stated[0], logs, options)
        nats = held_out_blocks(stated[0], [params for (params,), _ in candidates], whole, 1 - hold_out)
        blocks = judgement.held_out("wrench", nats, sum(float(part.dt.sum()) for part in chain(*unseen)))
        scores = [(joint, wrench) for (joint, _), wrench in zip(scores, blocks, strict=True)]
    if hold_out and wanted and alone:
        predicted = judgement.judge_predictions(setup, [own[0] for own in setups], logs, hold_out)
    plain, *moving = [
        TuneResult(own[0], found, judged, tuple(own[1:]), errors, reasons_against(judged, errors, shown))
        for (_, found), own, judged, errors in zip(candidates, setups, scores, predicted, strict=True)
    ]
    return next((result for result in moving if is_better(result, plain)), plain)


def _check(
    tools: Sequence[tuple[Setup, Sequence[Log]]],
    fit: Collection[str],
    tie: str,
    data_noise: str,
    hold_out: float,
    total: newton.Total,
) -> None:
    for other, _ in tools[1:]:
        require_one_robot(tools[0][0], other)
    if len(tools) > 1 and "data" not in fit:
        raise UsageError(
            "several tools are only needed to fit Sigma_D", field="fit", remedy="fit data too, or tune each tool alone"
        )
    if "data" in fit and total is not newton.alone:
        raise UsageError(
            "Sigma_D (data) can only be fitted in a single process",
            field="fit",
            remedy="leave out data, or the processes",
        )
    if data_noise not in KINDS:
        raise UsageError(f"got {data_noise!r}", field="data_noise", remedy=f"choose from {', '.join(KINDS)}")
    if unknown := [name for name in fit if name not in FIT]:
        raise UsageError(f"cannot fit {unknown[0]!r}", field="fit", remedy=f"choose from {', '.join(FIT)}")
    if not fit:
        raise UsageError("there is nothing to fit", field="fit", remedy=f"choose from {', '.join(FIT)}")
    if tie not in TIES:
        raise UsageError(f"got {tie!r}", field="tie", remedy=f"choose from {', '.join(TIES)}")
    if not 0 <= hold_out <= 0.9:
        raise UsageError(f"got {hold_out!r}", field="hold_out", remedy="give a share from 0 to 0.9")


def _part(samples: Sample, begin: float, end: float) -> Sample:
    """A part of a log, between two shares of its length, as a log of its own."""
    rows = slice(round(begin * len(samples.dt)), round(end * len(samples.dt)))
    part: Sample = jax.tree.map(lambda x: np.asarray(x)[rows], samples)
    return part._replace(dt=np.concatenate([[0], part.dt[1:]]))
