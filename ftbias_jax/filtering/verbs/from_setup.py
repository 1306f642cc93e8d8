"""The function ``filter_log``, which needs only a setup and a log."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any, TypedDict, Unpack, overload

from ftbias_jax.check.check_setup import check_parts, check_setup
from ftbias_jax.check.result import Check
from ftbias_jax.errors import FtbiasError
from ftbias_jax.filtering.method.ready import ready_to_filter
from ftbias_jax.filtering.method.runs import Steps, alone, in_sets
from ftbias_jax.filtering.noise.joint_scatter import remark_of_joints
from ftbias_jax.filtering.noise.log_noise import remarks_of_noise
from ftbias_jax.filtering.quality import contacts, observability, summary
from ftbias_jax.filtering.quality.at_rest import weight_in_bias
from ftbias_jax.filtering.quality.observability import remark_of_model, with_error_of_model
from ftbias_jax.filtering.result import Filtered, join, named_arrays
from ftbias_jax.filtering.samples import first_position
from ftbias_jax.filtering.verbs.results import FilterResult, FilterResults, only, require_fields
from ftbias_jax.io import GivenLog, as_log, each_of
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.parts import OpenLog
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.io.write.selection import About, names_of
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.runtime.jax_config import accelerator, in_float64, on_device
from ftbias_jax.runtime.many import results_of
from ftbias_jax.setup import GivenSetup, Setup, as_setup


def _nobody(done: int) -> None:
    """Progress callback that does nothing."""


class Choices(TypedDict, total=False):
    """Options of ``filter_log``."""

    smooth: bool
    as_stated: bool
    unchecked: bool
    fields: Sequence[str]
    progress: Callable[[int], None]
    effects: Sequence[Effect]
    executor: Executor | None


@overload  # a path is a sequence of letters, too
def filter_log(setup: GivenSetup, log: GivenLog, **choices: Unpack[Choices]) -> FilterResult: ...  # type: ignore[overload-overlap]
@overload
def filter_log(setup: GivenSetup, log: Iterable[GivenLog], **choices: Unpack[Choices]) -> FilterResults: ...
@in_float64
def filter_log(
    setup: GivenSetup,
    log: GivenLog | Iterable[GivenLog],
    *,
    smooth: bool = False,
    as_stated: bool = False,
    unchecked: bool = False,
    fields: Sequence[str] = (),
    progress: Callable[[int], None] = _nobody,
    effects: Sequence[Effect] = (),
    executor: Executor | None = None,
) -> FilterResult | FilterResults:
    """Bias, drift and corrected wrench of one log or of many, at each sample from the wrench up to it.

    The joints are smoothed, because a recording also holds their future. Contact, vibration and slow errors are
    estimated from the log where the setup leaves them open (not with ``[bias] adapt = false``), and standard deviations
    that the log contradicts are enlarged. Computes in float64 whatever JAX's setting is, on the CPU unless JAX is told
    to use another device, and keeps compiled programs in the user's cache folder (not with ``FTBIAS_CACHE=off``).

    Args:
        setup: robot, sensor, tool and noise, or its path. The weight of a tool of unknown mass is part of the bias, if
            the log does not turn it.
        log: from ``read_log``, or its path. Or many of them, in a list or from a generator, which are taken one at a
            time, on an accelerator in sets: logs of all lengths share a few compiled programs, and each result is the
            same as for the log alone.
        smooth: add the bias given past and future.
        as_stated: filter as on the robot: joints from the past alone, noise and gate as the setup states. The joints'
            process noise is then LAG_GUARD times the most likely.
        unchecked: do not check first whether the setup can be right (``check_setup``); ``print`` reports if it is not.
        fields: names of the arrays that the result keeps beside t and log_likelihood, the others are None; () = all,
            which takes 0.8 kB a sample. ``summary`` and all else of the result are computed from the whole.
        progress: called with the number of samples done so far, of all logs.
        effects: your own effects that the setup states.
        executor: for many logs: its workers filter them, by ``concurrent.futures``, Dask's ``Client.get_executor()``,
            ``mpi4py.futures`` or ``loky``. They read paths themselves; what is sent to them must be picklable.

    Returns:
        arrays at the stamps of the wrench; ``print`` shows what ``ftbias filter`` prints. For many logs a sequence of
        such results in their order, with None for a log that cannot be read or filtered: ``errors`` states why.

    Raises:
        UsageError: there is no log, or no field of such a name. For a single log FtbiasError: it cannot be read or
            filtered.
    """
    fields = names_of(fields)
    require_fields(fields)
    setup, done = as_setup(setup, effects), 0
    setup = replace(setup, bias=replace(setup.bias, adapt=False)) if as_stated else setup

    steps = partial(_steps, setup=setup, smooth=smooth, unchecked=unchecked, fields=fields)
    work = partial(_filtered, steps)
    if isinstance(log, Log | str | os.PathLike):
        return work(log, progress=progress)
    device = None if executor else accelerator()
    in_turn = executor is None and device is None

    def tell(result: FilterResult | FtbiasError | None) -> None:
        nonlocal done
        if isinstance(result, FilterResult):
            done += len(result.t)
            if not in_turn:  # otherwise the log itself reports progress
                progress(done)

    if in_turn:
        work = partial(work, progress=lambda samples: progress(done + samples))
    sets = None if device is None else partial(in_sets, steps, device)
    with on_device(None):
        many = results_of(work, each_of(log, executor), executor, tell, sets)
    return FilterResults(many.results, many.errors)


def _filtered(steps: Callable[..., Steps[FilterResult]], log: GivenLog, **named: Any) -> FilterResult:
    return alone(steps(log, **named))


def _steps(
    log: GivenLog,
    setup: Setup,
    smooth: bool,
    unchecked: bool,
    fields: Sequence[str],
    progress: Callable[[int], None] = _nobody,
) -> Steps[FilterResult]:
    read = as_log(log, setup)
    result = yield from filter_with_setup(setup, read, smooth=smooth, unchecked=unchecked, progress=progress)
    return only(replace(result, repairs=(*map(Repair, result.checked.lines()), *result.repairs)), fields)


def filter_with_setup(
    setup: Setup,
    log: Log | OpenLog,
    *,
    smooth: bool = False,
    unchecked: bool = False,
    progress: Callable[[int], None] = _nobody,
    warn: Callable[[str], None] = lambda line: None,
    write: Callable[[Iterator[Filtered], Callable[[], About]], None] | None = None,
) -> Steps[FilterResult]:
    """Filter one log with a setup that has all effects: steps of ``filter_log`` and ``ftbias filter``; errors as there.

    Before anything is computed, ``warn`` is called with each mistake of the setup. If ``write`` is given, it receives
    the parts of the result as they come, and their metadata once the last one has come; the arrays of the result are
    then those of the last part.
    """
    if isinstance(log, OpenLog):
        parts, length, first_q, source, salvaged = log.parts, log.length, log.facts.first_q, log.source, log.salvaged
    else:
        parts, length, first_q, source, salvaged = slices(log), len(log.t), first_position(log.q), source_of(log), False
    setup, of_tool = weight_in_bias(setup, parts)
    checked = Check(())
    if not unchecked:
        checked = check_setup(setup, [log]) if isinstance(log, Log) else check_parts(setup, parts, length)
    for line in checked.lines():
        warn(line)
    ready = yield from ready_to_filter(setup, parts, length, first_q, smooth=smooth)
    tally, turning, touches = summary.start(), observability.start(), contacts.start(ready.noise.contacts)
    bias = setup.bias
    said: dict[str, Any] = {"smooth": smooth, "salvage": salvaged, "gate": bias.gate, "adapt": bias.adapt}
    said |= {"tool": "not stated: its weight is part of the bias"} if of_tool else {}
    origin = provenance(setup, [source], said)

    def results() -> Iterator[Filtered]:
        nonlocal tally, turning, touches
        done = 0
        for found in ready.results:
            part = with_error_of_model(found, setup, log.acceleration_std, ready.noise.tool_error)
            tally, turning = summary.add(tally, part, ready.params.bias), observability.add(turning, ready.params, part)
            touches = contacts.add(touches, ready.noise.contacts, part, log.start)
            done += len(part.t)
            progress(done)
            yield part

    if write is None:
        filtered = join(list(results()))
    else:
        write(results(), lambda: About(log.frame, origin, [x.plain() for x in contacts.finish(touches)]))
        assert tally.last is not None  # no log is empty
        filtered = tally.last
    of_noise = (*remark_of_joints(setup, ready.params), *remarks_of_noise(ready.noise))
    return FilterResult(
        **named_arrays(filtered),
        params=ready.params,
        noise=ready.noise,
        joint_model=setup.joints.model,
        repairs=(*log.repairs, *of_tool, *remark_of_model(setup), *of_noise, *observability.remarks(turning)),
        checked=checked,
        start=log.start,
        summary=summary.finish(tally),
        contacts=contacts.finish(touches),
        frame=log.frame,
        provenance=origin,
    )
