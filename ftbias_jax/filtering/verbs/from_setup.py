"""The verb of filtering: everything it needs is in a setup and a log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import overload

from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.errors import FtbiasError, UsageError
from ftbias_jax.filtering.method.ready import ready_to_filter
from ftbias_jax.filtering.noise.log_noise import remark_of_gate
from ftbias_jax.filtering.quality import observability
from ftbias_jax.filtering.quality.at_rest import weight_in_bias
from ftbias_jax.filtering.quality.contacts import contact_intervals
from ftbias_jax.filtering.quality.observability import remark_of_tool, with_error_of_tool
from ftbias_jax.filtering.quality.summary import summarise
from ftbias_jax.filtering.result import join, named_arrays
from ftbias_jax.filtering.samples import first_position
from ftbias_jax.filtering.verbs.results import FilterResult, FilterResults, only, require_fields
from ftbias_jax.io import read_log
from ftbias_jax.io.cleaning import slices
from ftbias_jax.io.log import Log, Repair
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.model.effects.types import Effect
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.setup.types import Setup


def _nobody(done: int) -> None:
    """Progress that nobody wants to know."""


Source = Log | str | os.PathLike[str]
"""A log, or the path of one."""


@overload
def filter_log(  # type: ignore[overload-overlap]  # a path is a sequence of letters, too
    setup: Setup,
    log: Source,
    *,
    smooth: bool = False,
    as_stated: bool = False,
    unchecked: bool = False,
    fields: Sequence[str] = (),
    progress: Callable[[int], None] = _nobody,
    effects: Sequence[Effect] = (),
) -> FilterResult: ...
@overload
def filter_log(
    setup: Setup,
    log: Iterable[Source],
    *,
    smooth: bool = False,
    as_stated: bool = False,
    unchecked: bool = False,
    fields: Sequence[str] = (),
    progress: Callable[[int], None] = _nobody,
    effects: Sequence[Effect] = (),
) -> FilterResults: ...
@in_float64
def filter_log(
    setup: Setup,
    log: Source | Iterable[Source],
    *,
    smooth: bool = False,
    as_stated: bool = False,
    unchecked: bool = False,
    fields: Sequence[str] = (),
    progress: Callable[[int], None] = _nobody,
    effects: Sequence[Effect] = (),
) -> FilterResult | FilterResults:
    """Bias, drift and corrected wrench of a log or of many logs, each from the wrench samples before it.

    The joints are smoothed, for a recording has their future too. Contact, vibration and slow errors are taken from the
    log where the setup leaves them open (``[bias] adapt = false`` does not), and standard deviations that the log
    contradicts are enlarged. Computes in float64 whatever JAX's setting is, and keeps compiled programs in the user's
    cache folder (``FTBIAS_CACHE=off`` does not).

    Args:
        setup: robot, sensor, tool and noise. A tool of unknown mass is part of the bias, if the log does not turn it.
        log: what ``read_log`` gives, or its path. Or many of them, in a list or from a generator, which are taken one
            at a time: logs of all lengths share a few compiled programs, and each result is that of the log alone.
        smooth: add the bias given past and future.
        as_stated: as a filter on the robot would: joints from the past alone, noise and gate as the setup states. The
            joints' process noise is then LAG_GUARD times the likeliest.
        unchecked: do not look first whether the setup can be right (``check_setup``); ``print`` says so if it is not.
        fields: names of the arrays that the result keeps beside t and log_likelihood, the others are None; () = all,
            which takes 0.8 kB a sample. ``summary`` and all else of the result are worked out from the whole.
        progress: called with the number of samples done so far, of all logs.
        effects: of your own that the setup states.

    Returns:
        arrays at the stamps of the wrench; ``print`` shows what ``ftbias filter`` prints. Of many logs a sequence of
        such results in their order, with None for a log that cannot be read or filtered: ``errors`` says why.

    Raises:
        UsageError: there is no log, or no field of such a name. Of a single log FtbiasError: it cannot be read or
            filtered.
    """
    require_fields(fields)
    setup, done = setup.with_effects(effects), 0

    def one(source: Source) -> FilterResult:
        nonlocal done
        log, before = source if isinstance(source, Log) else read_log(source, setup), done
        choices = {"smooth": smooth, "as_stated": as_stated, "unchecked": unchecked}
        result = _filter(setup, log, **choices, progress=lambda samples: progress(before + samples))
        done = before + len(result.t)
        return only(result, fields)

    if isinstance(log, Log | str | os.PathLike):
        return one(log)
    results: list[FilterResult | None] = []
    errors: dict[int, FtbiasError] = {}
    for i, source in enumerate(log):
        try:
            results.append(one(source))
        except FtbiasError as error:
            results.append(None)
            errors[i] = error
    if not results:
        raise UsageError("there is no log to filter", field="log", remedy="give at least one")
    return FilterResults(tuple(results), errors)


def _filter(
    setup: Setup, log: Log, *, smooth: bool, as_stated: bool, unchecked: bool, progress: Callable[[int], None]
) -> FilterResult:
    """The result of one log."""
    setup, of_tool = weight_in_bias(setup, slices(log))
    of_tool = (*of_tool, *remark_of_tool(setup.tool))
    wrong = () if unchecked else check_setup(setup, [log]).lines()
    if as_stated:
        setup = replace(setup, bias=replace(setup.bias, adapt=False))
    ready = ready_to_filter(setup, slices(log), len(log.t), first_position(log.q), smooth=smooth)
    of_gate = remark_of_gate(ready.noise)
    parts = []
    for part in ready.results:
        parts.append(with_error_of_tool(part, setup.tool))
        progress(sum(len(done.t) for done in parts))
    filtered = join(parts)
    bias = setup.bias
    turning = observability.add(observability.start(), ready.params, filtered)
    return FilterResult(
        **named_arrays(filtered),
        params=ready.params,
        noise=ready.noise,
        joint_model=setup.joints.model,
        repairs=(*map(Repair, wrong), *log.repairs, *of_tool, *of_gate, *observability.remarks(turning)),
        warnings=(*wrong, *(repair.what for repair in of_gate if repair.lost)),
        start=log.start,
        summary=summarise(filtered, ready.params.bias),
        contacts=contact_intervals(filtered, ready.noise.contacts, log.start),
        frame=log.frame,
        provenance=provenance(setup, [source_of(log)], {"smooth": smooth, "gate": bias.gate, "adapt": bias.adapt}),
    )
