"""``ftbias simulate``: a log as a robot would record it, with the truth in another file. ``ftbias plan``: the motion
that is most informative about the tool, the noise or effects."""

import argparse
from functools import partial
from typing import Any

from ftbias_jax.cli.given import logs_of, setup_of, start_jax, write_answers
from ftbias_jax.cli.terminal import print_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.write import writer
from ftbias_jax.io.write.outputs import EXPORT, LOG, PAGE, PLAN, RESULT, check_outputs, check_writable
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import load_setup

GENERATED = ("sines", "moves")
"""Motions that are generated instead of being read from a log."""
CONTROLLERS = {"ros": ".yaml", "bag": ".mcap", "ur": ".script", "franka": ".json"}
"""Option of ``plan`` -> suffix of its file; the formats are those of ``planning.controllers``."""


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
    start_jax()
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
    return print_repairs((path, log.repairs) for path, log in recorded.items())


def plan_motion(arguments: argparse.Namespace) -> int:
    """``ftbias plan``: plan a motion and write it; returns 3 if samples of a log were lost, else 0."""
    writer(arguments.output)
    wanted = {name: getattr(arguments, name) for name in CONTROLLERS if getattr(arguments, name)}
    for name, path in wanted.items():
        check_writable(path, CONTROLLERS[name], f"--{name}")
    setup = setup_of(arguments, with_tool=True)
    kinds = {"--output": RESULT, "--json": PLAN, "--html": PAGE} | {f"--{name}": EXPORT for name in CONTROLLERS}
    paths = logs_of(arguments, setup, kinds, stated=(arguments.diagnosis, *setup.files))
    with Stages("planning") as stages:
        stages("reading")
        logs = [read_log(path, setup, raw=True) for path in paths]
        start_jax()
        from ftbias_jax.model.own_effects import catalogue_of_setup, load_all
        from ftbias_jax.planning.controllers import check_controllers
        from ftbias_jax.planning.diagnosed import Diagnosed, read_diagnosis
        from ftbias_jax.planning.plan import plan

        check_controllers(setup, wanted)

        setup = setup.with_effects(load_all(tuple(arguments.own_effects)))
        found = Diagnosed({}, "")
        if arguments.diagnosis:
            found = read_diagnosis(arguments.diagnosis, catalogue_of_setup(setup))
        made = plan(
            setup,
            arguments.to_find or found.twins or "tool",
            duration=arguments.duration,
            rate=arguments.rate,
            start=arguments.start,
            logs=logs,
            values=found.values,
            margin=arguments.margin,
            seed=arguments.seed,
            progress=stages,
        )
    print(made)
    answers = {arguments.output: made.save, arguments.json: made.to_json, arguments.html: made.to_html}
    write_answers({**answers, **{path: partial(made.save_for, format=name) for name, path in wanted.items()}})
    return print_repairs(zip(paths, (log.repairs for log in logs), strict=True))


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
