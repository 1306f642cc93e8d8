"""``ftbias simulate``: a log as a robot would record it, and what is true about it in another file."""

from __future__ import annotations

import argparse
from typing import Any

from ftbias_jax.cli.terminal import tell_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.write.ours import LOG
from ftbias_jax.setup import load_setup

GENERATED = ("sines", "moves")
"""Motions that are not read from a log."""


def run(arguments: argparse.Namespace) -> int:
    """Simulate one log; returns 3 if samples of the log to replay were lost, else 0."""
    check_writable(arguments.output, ".npz")
    truth_path = arguments.truth or f"{arguments.output.removesuffix('.npz')}_truth.npz"
    check_writable(truth_path, ".json" if truth_path.endswith(".json") else ".npz", "--truth")
    setup = load_setup(arguments.setup, with_tool=True, allow_outside=arguments.allow_outside)
    replayed = () if arguments.motion in GENERATED else (arguments.motion,)
    outputs = {"--output": arguments.output, "--truth": truth_path}
    check_outputs(outputs, (*replayed, *setup.files), dict.fromkeys(outputs, LOG), arguments.force)
    recorded = {path: read_log(path, setup) for path in replayed}

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.model.own_effects import catalogue_of_setup, load_all
    from ftbias_jax.model.simulate_log import check_effects, simulate

    setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
    effects = dict(map(split_effect, arguments.effect))
    check_effects(effects, catalogue_of_setup(setup), "--effect")
    simulated = simulate(
        setup,
        effects,
        duration=arguments.duration,
        rate=arguments.rate,
        motion=recorded.get(arguments.motion, arguments.motion),
        seed=arguments.seed,
    )
    simulated.save(arguments.output, truth_path)
    print(simulated)
    print(f"wrote {arguments.output} and {truth_path}")
    return tell_repairs((path, log.repairs) for path, log in recorded.items())


def split_effect(text: str) -> tuple[str, dict[str, Any]]:
    """NAME or NAME:key=value,key=1/2/3 -> (NAME, {key: values}).

    Raises:
        UsageError: a value is not a number, or is missing.
    """
    name, _, assignments = text.partition(":")
    values: dict[str, Any] = {}
    for assignment in filter(None, assignments.split(",")):
        key, _, numbers = assignment.partition("=")
        try:
            values[key] = [float(number) for number in numbers.split("/")]
        except ValueError as error:
            message = f"cannot read {assignment!r}"
            remedy = "write key=value or key=1/2/3"
            raise UsageError(message, file="--effect", field=name, remedy=remedy) from error
    return name, values
