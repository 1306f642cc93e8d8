"""``ftbias export``: a tool as a payload or as parameters of ROS; layouts for viewers of MCAP results."""

from __future__ import annotations

import argparse

from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import write_atomic
from ftbias_jax.io.outputs import check_outputs, check_writable
from ftbias_jax.io.write.mcap import LAYOUTS
from ftbias_jax.io.write.ours import EXPORT
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.export import export_text
from ftbias_jax.setup.export.options import ExportOptions


def run(arguments: argparse.Namespace) -> int:
    """Write or print what is asked for; returns 0."""
    output = arguments.output
    if output:
        check_writable(output)
        check_outputs({"--output": output}, [arguments.setup], {"--output": EXPORT}, arguments.force)
    text = _text(arguments)
    if not output:
        print(text, end="")
        return 0
    write_atomic(output, lambda file: file.write(text.encode()))
    print(f"wrote {output}")
    return 0


def _text(arguments: argparse.Namespace) -> str:
    if arguments.format in LAYOUTS:
        return LAYOUTS[arguments.format]()
    if not arguments.setup:
        raise UsageError("needs a setup with the tool", field="SETUP.toml", remedy="name it")
    setup = load_setup(arguments.setup, with_tool=True)
    check_outputs({"--output": arguments.output}, setup.files)
    mass = arguments.sensor_mass
    if mass is not None and not (0 < mass[0] < 1000 and max(map(abs, mass[1:])) < 10):
        remedy = "give kg, and metres in the flange frame"
        raise UsageError(f"{' '.join(f'{x:g}' for x in mass)} is no mass", field="--sensor-mass", remedy=remedy)
    options = ExportOptions(
        sensor_mass=None if mass is None else tuple(mass),
        frames_as_stated=arguments.frames_as_stated,
        sensor_frame=arguments.sensor_frame,
        world_frame=arguments.world_frame,
    )
    return export_text(setup, arguments.format, options)
