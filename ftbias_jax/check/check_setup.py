"""The verb ``check_setup``: detect mistakes in the content of a setup from logs before anything is computed."""

from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial

import numpy as np

from ftbias_jax.check import findings, poses
from ftbias_jax.check.alternatives import all_alternatives, hanging, sign_of_one
from ftbias_jax.check.bins import WIDTH, Bins, bins_of, join_bins
from ftbias_jax.check.contact import UNTOUCHED, mimicked_by_contact, stamped, untouched
from ftbias_jax.check.findings import absence, clocks, named, numbers, of_bias
from ftbias_jax.check.judge import (
    BAD,
    TIE,
    Evidence,
    best_alternatives,
    decisively,
    is_pulled,
    much_is_left,
    score,
    slightly,
)
from ftbias_jax.check.mounts import mount_in_degrees
from ftbias_jax.check.regression import TRIMS, no_tool
from ftbias_jax.check.result import Check, Mistake
from ftbias_jax.check.state import FEWEST, Case, State, case_of_bins, stated
from ftbias_jax.check.undetermined import all_undetermined, undetermined
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.io import GivenMotion, as_motion, each_of
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.setup import GivenSetup, Setup, as_setup

MOST_MISTAKES = 2
"""Maximum number of mistakes sought besides those of a recorded pose; the second with the first one corrected."""
PART, MOST_PARTS = 1 << 17, 16
"""Samples per part of a long log, and number of parts that are checked."""
FAR_BETTER = 2.0
"""Margin in score by which an alternative must beat the model without a tool if the tool's weight seems absent."""
WEAK = {"worse_than_raw", "raw_offset", "rezeroed", "compensated"}
"""Mistakes that contact can mimic: they are reported only if trimming likely contact bins reveals no other mistake,
unless undoing them explains the reading."""
FITTED = "torque_rms_if_mended"
"""Key of the evidence of a mistake whose undoing was fitted."""
OF_AXES = {"sign", "gravity", "sensor_axes"}
"""Mistakes that change the direction of a weight but not its magnitude."""
FAR_SMALLER = 0.05
"""Ratio of the raw variance to the residual variance of the setup below which OF_AXES cannot explain the reading."""
POSE_TIE = 0.1
"""Difference of scores within which two conventions of a pose count as equally good."""


def check_setup(
    setup: GivenSetup, logs: GivenMotion | Iterable[GivenMotion], *, executor: Executor | None = None
) -> Check:
    """Check a setup against logs for mistakes in signs, units, frames and gravity, and for an offset.

    The wrench is fitted by least squares with a free bias, once with the setup as stated and once with each of a list
    of mistakes undone. A mistake is reported only if undoing it explains held-out blocks of the log decisively better,
    and neither an effect of the catalogue nor another tool would do. Takes a fraction of a second and does not need
    JAX.

    Args:
        setup: the setup as its owner states it, or its path.
        logs: of this robot, sensor and tool, as ``read_log`` returns them, or static poses, as ``read_poses`` does; or
            their paths.
        executor: reads and bins several logs in its workers, as for ``filter_log``.

    Raises:
        UsageError: there is no log, or logs of motion and static poses are mixed. LogError: one cannot be read.
    """
    setup, logs = as_setup(setup), list(each_of(logs))
    if not logs:
        raise UsageError("there is no log to check", field="logs", remedy="give at least one")
    alone = [as_motion(logs[0], setup)] if len(logs) == 1 else []
    if executor is None or alone:
        read = [_in_bins(setup, log) for log in alone or logs]
    else:
        from ftbias_jax.runtime.many import do_all

        read = do_all(partial(_in_bins, setup), each_of(logs, executor), executor)
    bins, are_poses = zip(*read, strict=True)
    if len(set(are_poses)) > 1:
        remedy = "check each kind by itself"
        raise UsageError("logs of motion and static poses are not checked together", field="logs", remedy=remedy)
    check = check_case(case_of_bins(setup, bins, are_poses[0]), setup)
    return stamped(check, setup, alone[0]) if alone else check  # times of several logs differ


def _in_bins(setup: Setup, log: GivenMotion) -> tuple[Bins, bool]:
    """Bin a log; also return whether it consists of static poses."""
    log = as_motion(log, setup)
    return bins_of(log, setup), isinstance(log, Poses)


def require_right(
    setup: Setup, logs: Iterable[Log | Poses], command: str, unchecked: bool, looked_for: Collection[str] = ()
) -> None:
    """Raise an error if the logs show the setup to be wrong, or if the command has nothing to estimate in the reading.

    The logs are free of stuck and clipped samples, and are not checked if ``unchecked``. Mistakes in ``looked_for`` are
    accepted, because the command (tune, identify or diagnose) is run to correct them.

    Raises:
        UsageError: the command estimates the tool, but the controller has subtracted it from the reading.
        SetupError: the setup is wrong. LogError: the logs are in units or frames that no setup can state, or too short
            for a diagnosis.
    """
    refused = {"identify": ("weight", "tool"), "diagnose": ("weight",)}
    if setup.sensor.compensated in refused.get(command, ()):
        more = ', or state "tool": inertia then counts as a gap' if command == "diagnose" else ""
        message, remedy = "the tool's weight is not in the reading", f"record the raw wrench{more}"
        raise UsageError(message, file=setup.path, field="sensor.compensated", remedy=remedy)
    logs = list(logs)
    seconds = max((log.t[-1] - log.t[0] for log in logs if isinstance(log, Log)), default=np.inf)
    if command == "diagnose" and seconds < FEWEST * WIDTH:
        remedy = f"record more than {FEWEST * WIDTH:.2g} s; 20 s of motion show most"
        raise LogError(f"lasts {seconds:.3g} s: too short to tell a gap from the bias", field="t", remedy=remedy)
    if not unchecked:
        check_setup(setup, logs).require_ok(command, looked_for)


def check_case(case: Case | None, setup: Setup) -> Check:
    """Check a setup against binned logs, as ``check_setup`` does; None = too few bins."""
    if case is None:
        return Check((), {}, setup.path, all_undetermined(pose=setup.pose is not None))
    checks: list[Check] = []
    trims = [trim for trim in TRIMS if trim == TRIMS[0] or (1 - trim) * len(case.log) >= FEWEST]
    for trim in trims:
        first = Evidence(stated(case.trimmed(trim)))
        checks.append(_check(first, tool_is_stated=not setup.tool.unknown))
        if checks[-1].ok and (first.left < BAD).all():
            break
        if any(one.mistake not in WEAK or FITTED in one.evidence for one in checks[-1].findings):
            return checks[-1]
    check = next((check for check in checks if not check.ok), checks[0])
    unseen = [{kind.mistake for kind in other.undetermined} for other in checks]
    for trim in trims[len(checks) :] if check.undetermined else ():  # a mistake might only show with these trims
        kinds = undetermined(Evidence(stated(case.trimmed(trim))), tool_is_stated=not setup.tool.unknown)
        unseen.append({kind.mistake for kind in kinds})
    never = set.intersection(*unseen)
    return replace(check, undetermined=tuple(kind for kind in check.undetermined if kind.mistake in never))


def check_parts(setup: Setup, parts: Callable[[int], Iterator[Log]], length: int) -> Check:
    """Check a setup against one log of ``length`` samples, read in parts; of a long log only some are checked."""
    if length <= PART:
        return check_setup(setup, [next(parts(length))])
    every = max(1, length // PART // MOST_PARTS)
    bins = [bins_of(part, setup) for i, part in enumerate(parts(PART)) if i % every == 0]
    return check_case(case_of_bins(setup, [join_bins(bins)]), setup)


def _check(first: Evidence, *, tool_is_stated: bool) -> Check:
    """Check a setup on the bins that the case's trim leaves for fits."""
    state, case = first.state, first.state.case
    setup = case.setup
    if setup.sensor.compensated == "weight":
        state = state.but(gravity=np.zeros(3))
    if setup.sensor.compensated == "tool":
        state = state.but(tool=no_tool())
    if setup.sensor.compensated != "none":
        first = Evidence(state)
        unseen = undetermined(first, tool_is_stated=tool_is_stated)
        return Check(tuple(of_bias(first)), numbers(first, first.result), setup.path, unseen)
    found: list[Mistake] = []
    if setup.pose is not None:
        state, of_pose = _of_pose(first)
        found += of_pose
    base = Evidence(state) if found else first
    absent = tuple(absence(base))
    enough = score(base, base.without_tool) + FAR_BETTER if absent else -np.inf
    for _ in range(MOST_MISTAKES):
        small = base.raw[0] < FAR_SMALLER * base.exact[0]
        tried = (a for a in all_alternatives(base.state) if not (small and a.mistake in OF_AXES))
        # No effect resembles these, however little they change.
        best = best_alternatives(base, tried) or slightly(
            base, (*mount_in_degrees(base.state), *sign_of_one(base.state), *hanging(base.state))
        )
        part = untouched(base) if best else None
        best = [
            (alternative, result) for alternative, result in best if not mimicked_by_contact(part, alternative, result)
        ]
        moved = None if case.layout.touched or not case.moves else findings.time_offset(base)
        if moved is not None and (not best or score(base, moved[1]) > score(base, best[0][1]) + TIE):
            found.append(clocks(base, first, *moved))
            break
        if not best or score(base, best[0][1]) < enough:
            break
        found.append(named(first, best))
        base, enough = Evidence(best[0][0].state), -np.inf
    found += absent if not found else ()
    if not any(mistake.mistake in ("compensated", "time_offset") for mistake in found):
        found += of_bias(base)
    worse = tool_is_stated and findings.worse_than_raw(first) and not _is_right_where_untouched(first)
    if worse and not found and not is_pulled(first):
        found.append(findings.as_stated(first))
    kinds = {kind.mistake for mistake in found for kind in (mistake, *mistake.alike)}
    unseen = tuple(kind for kind in undetermined(base, tool_is_stated=tool_is_stated) if kind.mistake not in kinds)
    evidence = {**numbers(first, first.result), "worse_than_raw": worse, "much_is_left": much_is_left(first)}
    return Check(tuple(found), evidence, setup.path, unseen)


def _is_right_where_untouched(first: Evidence) -> bool:
    """Return whether the tool as stated fits better than no tool in the contact-free part of the log."""
    if untouched(first) is None:
        return False
    return not findings.worse_than_raw(Evidence(first.state.but(case=first.state.case.trimmed(UNTOUCHED))))


def _of_pose(first: Evidence) -> tuple[State, list[Mistake]]:
    """Return the state with the pose's conventions corrected, and the mistakes found in them."""
    state, found = first.state, []
    pose = state.case.setup.pose
    assert pose is not None
    tried = [
        # The better fit of the reading and of its negative, because the sign is checked later.
        (convention, s, min((s.fit(), s.but(wrench=-s.wrench).fit()), key=lambda result: result.square[0]))
        for convention, s in poses.conventions(state)
    ]
    as_stated = tried[0][2]
    good = [
        (convention, s, result)
        for convention, s, result in tried[1:]
        if result.square[0] < poses.POSE_BETTER * as_stated.square[0]
        and result.square[0] < BAD * first.raw[0]
        and decisively(as_stated, result, (0,), state.case.layout.block)
    ]
    if good:
        best = max(score(first, result) for *_, result in good)
        ties = [entry for entry in good if score(first, entry[2]) > best - POSE_TIE]
        convention, state, result = min(ties, key=lambda entry: sum(vars(entry[0]).values()))
        for mistake, remedy, setup in convention.findings(pose):
            found.append(Mistake(mistake, numbers(first, result), remedy, setup))
    in_g = poses.accelerometer_mistake(state)
    found += [mistake for mistake in (poses.gyroscope_mistake(state), in_g) if mistake is not None]
    if in_g is not None and state.specific_force is not None:
        state = state.but(specific_force=9.80665 * state.specific_force)
    return state, found
