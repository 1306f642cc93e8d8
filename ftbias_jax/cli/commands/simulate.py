"""``ftbias simulate``: a log as a robot would record it, and what is true about it in another file."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from ftbias_jax.cli.commands.filter import check_outputs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.sensor_pose import require_arm


def run(arguments: argparse.Namespace) -> int:
    """Simulate one log; returns 0."""
    check_outputs(arguments.output, ".npz")
    truth_path = arguments.truth or f"{arguments.output.removesuffix('.npz')}_truth.npz"
    check_outputs(truth_path, ".json" if truth_path.endswith(".json") else ".npz")
    if Path(truth_path).resolve() == Path(arguments.output).resolve():
        raise UsageError("log and truth have the same name", field="--truth", remedy="give them different ones")
    setup = load_setup(arguments.setup)
    require_arm(setup)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.model.simulate_log import check_effects, simulate

    effects = dict(map(split_effect, arguments.effect))
    check_effects(effects, partial(UsageError, file="--effect"))
    stated = arguments.motion in ("sines", "moves")
    simulated = simulate(
        setup,
        effects,
        duration=arguments.duration,
        rate=arguments.rate,
        motion=arguments.motion if stated else read_log(arguments.motion, setup),
        seed=arguments.seed,
    )
    simulated.save(arguments.output, truth_path)
    print(simulated)
    print(f"wrote {arguments.output} and {truth_path}")
    return 0


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
