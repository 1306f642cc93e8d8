"""Calibration of a setup from logs: each step is kept only if it predicts held-out data better.

The end of every log is held out. Causes are searched for, and the tool is identified, in what comes before; a step is
kept if the setup with it predicts the readings of the end better, 1 s and 10 s ahead, than the setup without.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ftbias_jax.calibration.identify_tool import identify_tool
from ftbias_jax.commissioning import result
from ftbias_jax.commissioning.drafted import as_uncertain, larger, loosened, with_loose_tool
from ftbias_jax.commissioning.events import is_bias_alone, without_events
from ftbias_jax.commissioning.judged import baselines, compare, judge
from ftbias_jax.commissioning.logs import longest, without_end
from ftbias_jax.commissioning.mounting import with_mounting
from ftbias_jax.commissioning.repeat import repeat
from ftbias_jax.commissioning.state import Context, State
from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.regression.chain_model import compiled_ahead, programs_of_search
from ftbias_jax.errors import FtbiasError, UsageError
from ftbias_jax.io import GivenLog, as_logs, names_of
from ftbias_jax.io.cleaning import clean
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.runtime.jax_config import in_float64, same_precision
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, as_setup
from ftbias_jax.setup.export.payload import with_effects_in_keys
from ftbias_jax.setup.types import COMPENSATED, Setup

QUIETER = 3.0
"""Factor by which the unseen accelerations of a pose log are divided or multiplied to try other noise."""
LOUDEST = 3.0
"""m/s^2, upper limit of these trials: no arm accelerates as much for long."""
NEGLIGIBLE = 1e-4
"""Relative decrease of the errors; noise that gains less is not divided or multiplied further."""
WORKERS = 2
"""Threads beside the one that evaluates steps."""
ROUNDS = 3
"""Rounds of diagnosis and identification; most logs show nothing more after the first."""


@in_float64
def calibrate(
    setup: GivenSetup,
    logs: GivenLog | Iterable[GivenLog],
    names: Sequence[str] = (),
    *,
    bias: bool = False,
    hold_out: float = 0.25,
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> result.Calibrated:
    """Find causes of a gap and the tool, and keep those that predict the held-out end of the logs better.

    A tool that the setup states without standard errors is the start of the search, and is replaced if another one
    predicts better. At the end the steps that were kept are repeated with the whole logs, if these show the same causes
    and the result predicts no worse; events of these logs alone are left out. Computes in float64, and keeps compiled
    programs in the user's cache folder (``FTBIAS_CACHE=off`` disables it).

    Args:
        setup: setup with robot, sensor and noise, or its path; its tool may be a draft, or not be stated.
        logs: logs of free motion of one robot, sensor and tool, or their paths; best as recorded, as for ``diagnose``.
        names: names of the logs for the report, as for ``diagnose``.
        bias: also write the bias at the end of the longest log into the setup, as the prior of logs recorded next.
        hold_out: share at the end of each log that is held out to evaluate the steps, 0.1 to 0.9.
        unchecked: skip the check whether the setup can be right (``check_setup``).
        progress: called with the name of each stage as it begins.

    Raises:
        UsageError: no log, or an impossible share. SetupError, LogError: the logs show a mistake of units, signs or
            frames, or cannot be filtered.
    """
    begin, given = time.monotonic(), as_setup(setup)
    logs = as_logs(logs, given, raw=True)
    if not 0.1 <= hold_out <= 0.9:
        raise UsageError(f"got {hold_out!r}", field="hold_out", remedy="give a share from 0.1 to 0.9")
    progress("checking the setup")
    whole, names = [clean(log) for log in logs], names or names_of(logs)
    begun = [without_end(log, hold_out) for log in logs]
    setup, mounted = (given, ()) if unchecked else with_mounting(given, whole, begun, progress)
    start = with_loose_tool(setup)

    def again(state: State) -> Setup | None:
        return repeat(state.steps, start, state.setup, logs, names, state.unmoved is not None, bool(mounted))

    with ThreadPoolExecutor(WORKERS) as worker:
        road = Context(whole, begun, names, hold_out, progress, again, worker, bool(mounted))
        first, state, repeating = _run_steps(road, setup, start)
    if state.unmoved is not None:
        state = state._replace(setup=as_uncertain(replace(state.setup, tool=state.unmoved), state.beside))
    rows = {result.GIVEN: judge(given, whole, hold_out) if mounted else first.judged}
    rows |= ({result.CALIBRATED: state.judged} if mounted or state.setup is not start else {}) | baselines(state.judged)
    final = replace(state.setup, tool=setup.tool) if state.setup.tool is start.tool else state.setup
    if state.setup is not start:
        progress("repeating what was kept with all of the logs")
        repeated = repeating.result() if repeating is not None else again(state)
        if repeated is not None and not compare(judge(repeated, whole, hold_out), state.judged).is_worse:
            final = repeated
    final, events = without_events(final, setup)
    final = with_effects_in_keys(final, keep=given.effects)
    if bias:
        progress("taking the bias of the longest log")
        found = identify_tool(final, longest(logs), bias=True, translation=False, unchecked=True)
        final = replace(final, bias=found.setup.bias)
    repairs = tuple(
        (*log.repairs, *result.other_tool(error, len(logs)))
        for log, error in zip(whole, state.judged.tool_error, strict=True)
    )
    seconds = time.monotonic() - begin
    return result.Calibrated(final, (*mounted, *state.steps), rows, state.found, repairs, seconds, events)


def _run_steps(road: Context, setup: Setup, start: Setup) -> tuple[State, State, Future[Setup | None] | None]:
    """Run all steps: the states before and after them, from a setup whose tool may have widened standard errors.

    Also returns the repetition of all steps that were kept, if it was begun while a last round found nothing more.
    """
    has_tool = setup.sensor.compensated == COMPENSATED[0]
    with compiled_ahead(start, road.begun):
        road.progress("filtering with the setup as given")
        # Crosstalk or a term would otherwise absorb the effect of a wrong tool.
        tool_first = has_tool and start.tool is not setup.tool
        # The place of the sensor comes after the causes: a delay looks like a lever arm, too.
        ahead = road.tool_ahead(start, translation=False) if tool_first else None
        judged = judge(start if setup.tool.unknown else setup, road.whole, road.hold_out)
        state = first = State(start, judged, (), ahead=ahead)
        if tool_first:
            state = _with_tool(state, road, (result.FIRST,))
    identified, rest = None, (result.CHANNELS,) if has_tool else ()
    for i in range(ROUNDS):
        before = state.setup
        repeated = road.worker.submit(road.again, state) if i else None  # most logs show nothing more
        state = _with_causes(state, road)
        if state.setup is not identified:
            state = _with_tool(state, road, (result.TOOL,) if has_tool else ())
            identified = state.setup
            state = _with_noise(state, road)
        if state.setup is before:  # last, because this many numbers absorb whatever is left
            state, rest = _with_tool(state, road, rest), ()
            if state.setup is before:
                return first, state, repeated
    return first, state, None


def _with_causes(state: State, road: Context) -> State:
    """Try the causes that a diagnosis names, and then the terms that it adds; keep them if they predict better."""
    road.progress("diagnosing")
    try:
        found = diagnose(state.setup, road.begun, road.names, unchecked=True)
    except FtbiasError as error:
        return _refused(state, result.CAUSES, "diagnose", str(error))
    state = state._replace(found=found)
    if not found.causes and not found.terms:
        return _refused(state, result.CAUSES, "diagnose", found.sentence)
    for kind, parts, named, terms in (
        (result.CAUSES, [cause.effect for cause in found.causes], [cause.title for cause in found.causes], ()),
        (result.TERMS, [term.drive for term in found.terms], [term.text for term in found.terms], found.terms),
    ):
        if parts:
            step = result.Step(kind, f"{kind[:-1]}: {', '.join(named)}", True, "", tuple(parts))
            setup = with_causes(state.setup, found.causes, terms, found.model_stderr)
            ahead = road.tool_ahead(setup)
            for prepare in programs_of_search(setup, road.begun):  # for the diagnosis that follows
                road.worker.submit(same_precision(prepare))
            state = _tried(state, road, step, setup, kind == result.TERMS and is_bias_alone(found, state.steps))
            if state.steps[-1].kept:
                state = state._replace(beside=larger(state.beside, found.tool_stderr), ahead=ahead)
    return state


def _with_tool(state: State, road: Context, kinds: Sequence[str]) -> State:
    """Try the tool that the longest log shows, or that and gains and crosstalk; keep them if they predict better."""
    for kind in kinds:
        crosstalk = kind == result.CHANNELS
        road.progress(f"identifying {kind}")
        try:
            if state.ahead is not None and state.ahead[0] is state.setup and not crosstalk:
                found = state.ahead[1].result()
            else:
                found = road.identify(state.setup, crosstalk=crosstalk)
        except FtbiasError as error:
            return _refused(state, kind, kind, str(error))
        if why := result.nothing_found(found, crosstalk):
            state = _refused(state, kind, kind, why)
            continue
        # A drafted tool is only a guess: the identified one replaces it unless it predicts worse.
        first = not crosstalk and not state.has_tool
        setup = as_uncertain(found.setup, state.beside)
        mass, stderr = found.tool.values[0], setup.tool.mass_std if np.isfinite(found.tool.stderr[0]) else None
        words = f"{kind}: {value_words(mass, stderr)} kg" if stderr else kind
        step = result.Step(kind, words, True, "", ("crosstalk" if crosstalk else "tool",))
        tried = loosened(setup, state.setup) if kind == result.FIRST else setup
        state = _tried(state, road, step, tried, first)
        if kind == result.FIRST and state.setup is tried:
            state = state._replace(identified=found.setup.tool)
    return state


def _with_noise(state: State, road: Context) -> State:
    """Try other unseen accelerations for a log of orientations; keep them if they predict better.

    A draft takes them from the scatter of the forces in motion, which contains all that the setup did not explain then;
    the filter uses no less noise than is stated.
    """
    if state.setup.pose is None or state.setup.pose.linear != "none":
        return state
    road.progress("trying the noise of unseen accelerations")
    tried = state
    for factor in (1 / QUIETER, QUIETER):
        best, pose = state, state.setup.pose
        while (std := float(f"{factor * pose.acceleration_std:.2g}")) < LOUDEST:
            step = result.Step(result.NOISE, f"unseen accelerations of {std:g} m/s^2", True, "", ("noise",))
            pose = replace(pose, acceleration_std=std)
            tried = _tried(state, road, step, replace(state.setup, pose=pose))
            if tried.setup.pose is not pose or compare(tried.judged, best.judged).share > -NEGLIGIBLE:
                break
            best = tried
        if best is not state:
            return best
    return tried


def _tried(state: State, road: Context, step: result.Step, setup: Setup, unless_worse: bool = False) -> State:
    """Evaluate a setup: the state with it if it is kept, and in any case with the outcome of its step."""
    try:
        judged = judge(setup, road.whole, road.hold_out)
    except FtbiasError as error:
        return _refused(state, step.kind, step.name, str(error))
    difference = compare(judged, state.judged)
    kept = not difference.is_worse if unless_worse else difference.is_better
    state = state._replace(steps=(*state.steps, replace(step, kept=kept, why=str(difference))))
    return state._replace(setup=setup, judged=judged) if kept else state


def _refused(state: State, kind: str, name: str, why: str) -> State:
    return state._replace(steps=(*state.steps, result.Step(kind, name, False, why)))
