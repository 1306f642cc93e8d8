"""``ftbias identify``: the tool's inertial parameters from a log."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ftbias_jax.cli.repairs import tell_repairs
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, output_of_setup
from ftbias_jax.setup import dump_setup, load_setup
from ftbias_jax.setup.types import Setup

if TYPE_CHECKING:
    from ftbias_jax.calibration.identify import Identified


def run(arguments: argparse.Namespace) -> int:
    """Identify the tool and write a setup that has it; 1 if it did not converge, else 3 if samples were lost."""
    output, kept = output_of_setup(arguments.output, arguments.setup, arguments.in_place)
    setup = load_setup(arguments.setup)
    check_outputs({"--output": output}, (arguments.log, *kept, setup.urdf))
    log = read_log(arguments.log, setup)

    from ftbias_jax.runtime.jax_config import prepare_jax

    prepare_jax()
    from ftbias_jax.calibration.identify import NAMES, UNITS, identify
    from ftbias_jax.filtering import filter_log
    from ftbias_jax.filtering.pipeline import Options
    from ftbias_jax.filtering.samples import samples_from_log

    options = Options(joint_model=setup.joints.model)
    params = filter_log.likeliest_params(setup, samples_from_log(log), options)
    samples = samples_from_log(filter_log.without_useless(log, params))
    found = identify(params, samples, options, arguments.mounting, arguments.gravity)

    print(f"{'':8s}{'value':>14s}{'± 1 sigma':>14s}")
    for name, unit, value, stderr in zip(NAMES, UNITS, found.values, found.stderr, strict=True):
        print(f"{name:8s}{value:14.6g}{stderr:14.2g}  {unit}")
    if arguments.mounting:
        print("sensor turned by", _with_errors(np.degrees(found.rotation), np.degrees(found.rotation_stderr)), "deg")
    if arguments.gravity:
        print("gravity", _with_errors(found.gravity, found.gravity_stderr), "m/s^2")
    print(f"likelihood gained: {found.gain:.1f} nats; condition number of the excitation: {found.condition:.0f}")
    if found.unexcited:
        print(f"this motion does not excite: {', '.join(found.unexcited)} (turn the wrist more, or accelerate more)")
    if not found.converged:
        print("ftbias: the search did not converge; the values are the best so far", file=sys.stderr)
    comments = _comments(found)
    if arguments.mounting:
        comments["sensor.rotation_rpy"] = (
            f"turned by the identified {_with_errors(found.rotation, found.rotation_stderr)}"
        )
    if arguments.gravity:
        comments["robot.gravity"] = f"identified ± {_plain(found.gravity_stderr)}"
    text = dump_setup(_with_tool(setup, found), comments)
    write_atomic(output, lambda file: file.write(text.encode()))
    print(f"wrote {output}")
    code = tell_repairs([(arguments.log, log.repairs)])
    return code if found.converged else 1


def _with_tool(setup: Setup, found: Identified) -> Setup:
    from ftbias_jax.model.kinematics.screws import rotation_from_vector

    turned = setup.sensor.rotation @ np.asarray(rotation_from_vector(found.rotation))
    tool = replace(setup.tool, mass=found.values[0], center_of_mass=found.values[1:4], inertia=found.values[4:])
    return replace(
        setup,
        tool=tool,
        sensor=replace(setup.sensor, rotation=turned),
        robot=replace(setup.robot, gravity=found.gravity),
    )


def _comments(found: Identified) -> dict[str, str]:
    return {
        "tool.mass": f"kg, identified ± {found.stderr[0]:.2g}",
        "tool.center_of_mass": f"m, sensor frame, identified ± {_plain(found.stderr[1:4])}",
        "tool.inertia": f"kg m^2, about the centre of mass, identified ± {_plain(found.stderr[4:])}",
    }


def _plain(values: np.ndarray) -> str:
    return " ".join(f"{x:.2g}" for x in values)


def _with_errors(values: np.ndarray, stderr: np.ndarray) -> str:
    return ", ".join(f"{x:.4g} ± {e:.2g}" for x, e in zip(values, stderr, strict=True))
