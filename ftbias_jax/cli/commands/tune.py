"""``ftbias tune``: noise parameters of maximum likelihood from one log or many."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, output_of_setup
from ftbias_jax.setup import dump_setup, load_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Sample

if TYPE_CHECKING:
    from ftbias_jax.calibration.tune import Fit
    from ftbias_jax.model.params import Params


def run(arguments: argparse.Namespace) -> int:
    """Tune and write a setup; 1 if a fit did not converge, else 3 if samples were lost.

    Of several processes, the first one speaks and writes.
    """
    output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = load_setup(arguments.setup)
    check_outputs({"--output": output}, (*arguments.logs, *kept, setup.urdf))
    first = read_log(arguments.logs[0], setup)  # every process starts from its noise

    import jax

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration import distributed, newton, tune
    from ftbias_jax.filtering import filter_log
    from ftbias_jax.filtering.likelihood import joint_log_likelihood, wrench_given_joints
    from ftbias_jax.filtering.pipeline import Options
    from ftbias_jax.filtering.samples import samples_from_log

    options = Options(joint_model=setup.joints.model)
    paths, total = arguments.logs, newton.alone
    if arguments.distributed is not None:
        distributed.start(*arguments.distributed)
        paths, total = distributed.share(paths), distributed.total
    speaks = jax.process_index() == 0
    start = params = filter_log.likeliest_params(setup, samples_from_log(first), options)
    logs = [first if path == arguments.logs[0] else read_log(path, setup) for path in paths]
    code = tell_repairs((path, log.repairs) for path, log in zip(paths, logs, strict=True))
    samples = [samples_from_log(filter_log.without_useless(log, params)) for log in logs]
    seen = [_part(log, 0, 1 - arguments.hold_out) for log in samples]
    fits: dict[str, Fit] = {}
    # The wrench needs the likeliest process noise of the joints, even if nobody asked for it.
    names = tune.JOINT_NAMES if "joints" in arguments.fit else tune.JOINT_NAMES[:1]
    restarts = arguments.restarts
    report = _reporter("joints") if speaks else newton.quiet
    params, joints = tune.tune_joints(
        params, seen, dict.fromkeys(names, "each"), options, restarts=restarts, report=report, total=total
    )
    if "joints" in arguments.fit:
        fits["joints"] = joints
    ties = {"density": "bias", "wrench_std": "sensor"}
    wanted = {name: arguments.tie for name, part in ties.items() if part in arguments.fit}
    if wanted:
        report = _reporter("wrench") if speaks else newton.quiet
        params, fits["wrench"] = tune.tune_wrench(
            params, seen, wanted, options, restarts=restarts, report=report, total=total
        )
    lines = [_table(fit) for fit in fits.values()]
    if arguments.hold_out:
        unseen = [_part(log, 1 - arguments.hold_out, 1) for log in samples]
        seconds = sum(float(part.dt.sum()) for part in unseen)
        scores = []
        for likelihood in (joint_log_likelihood, wrench_given_joints):
            score = jax.jit(partial(likelihood, options=options, burn_in=1.0))
            scores += [sum(float(score(p, x)) for x in unseen) for p in (start, params)]
        seconds, found = total(seconds, np.array(scores))
        for name, (before, after) in zip(("joint", "wrench"), found.reshape(2, 2) / seconds, strict=True):
            lines.append(f"held-out {name} score: {before:.1f} -> {after:.1f} nats/s ({after - before:+.1f})")
    converged = all(fit.optimum.converged for fit in fits.values())
    if not speaks:
        return code if converged else 1
    print("\n".join(lines))
    text = dump_setup(_with_noise(setup, params, fits), _comments(fits))
    write_atomic(output, lambda file: file.write(text.encode()))
    print(f"wrote {output}")
    if not converged:
        print("ftbias: a fit did not converge; its values are the best so far", file=sys.stderr)
    return code if converged else 1


def _part(samples: Sample, begin: float, end: float) -> Sample:
    """A share of a log as a log of its own."""
    rows = slice(round(begin * len(samples.dt)), round(end * len(samples.dt)))
    part = Sample(*(None if x is None else np.asarray(x)[rows] for x in samples))
    return part._replace(dt=np.concatenate([[0], part.dt[1:]]))


def _reporter(label: str) -> Callable[[int, float], None]:
    start = time.monotonic()
    terminal = sys.stderr.isatty()

    def report(iteration: int, value: float) -> None:
        elapsed = time.monotonic() - start
        if terminal or elapsed > 2:
            end = "\r" if terminal else "\n"
            print(
                f"{label}: iteration {iteration}, {value:.2f} nats, {elapsed:.0f} s",
                end=end,
                file=sys.stderr,
                flush=True,
            )

    return report


def _table(fit: Fit) -> str:
    lines = []
    for name, values in fit.values.items():
        errors = fit.relative_stderr[name] * values
        lines.append(f"{name:16s} " + "  ".join(f"{x:.3g} ± {e:.1g}" for x, e in zip(values, errors, strict=True)))
    found = fit.optimum
    lines.append(f"{'':16s} log-likelihood {found.value:.1f} nats; {found.agreeing} of {found.starts} starts agree")
    lines += [f"{'':16s} not determined by these logs: {words}" for words in fit.undetermined]
    return "\n".join(lines)


def _with_noise(setup: Setup, params: Params, fits: dict[str, Fit]) -> Setup:
    if "joints" in fits:
        joints = replace(
            setup.joints,
            process_noise_density=np.asarray(params.joint.process_density),
            position_noise_std=np.asarray(params.joint.position_std),
            velocity_noise_std=np.asarray(params.joint.velocity_std),
        )
        setup = replace(setup, joints=joints)
    if "wrench" in fits:
        setup = replace(
            setup,
            bias=replace(setup.bias, noise_density=np.asarray(params.bias.density)),
            sensor=replace(setup.sensor, noise_std=np.sqrt(np.asarray(params.bias.wrench_variance))),
        )
    return setup


def _comments(fits: dict[str, Fit]) -> dict[str, str]:
    keys = {
        "process_density": "joints.process_noise_density",
        "position_std": "joints.position_noise_std",
        "velocity_std": "joints.velocity_noise_std",
        "density": "bias.noise_density",
        "wrench_std": "sensor.noise_std",
    }
    comments = {
        keys[name]: "tuned, relative standard errors " + " ".join(f"{x:.1g}" for x in errors)
        for fit in fits.values()
        for name, errors in fit.relative_stderr.items()
    }
    density = keys["process_density"]
    return {key: words + ("; ftbias filter multiplies it" if key == density else "") for key, words in comments.items()}
