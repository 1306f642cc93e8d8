"""``ftbias export``: the tool for controllers and ROS, findings of a diagnosis for simulators, layouts for viewers."""

import argparse
import os
from collections.abc import Callable
from functools import partial

from ftbias_jax import __version__
from ftbias_jax.cli.given import write_answers
from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.write.mcap import LAYOUTS, layout
from ftbias_jax.io.write.outputs import EXPORT, NOT_EXPRESSED, SETUP, check_outputs, check_writable
from ftbias_jax.setup import Setup, load_setup
from ftbias_jax.setup.export import export_text
from ftbias_jax.setup.export.payload import ExportOptions
from ftbias_jax.setup.mjcf import Mjcf, load_mjcf
from ftbias_jax.setup.save import WRITTEN_BY, write_text

OF_SIMULATORS = ("mjcf", "urdf", "sensor")


def run(arguments: argparse.Namespace) -> int:
    """Write or print the requested export; returns 0."""
    output = arguments.output
    if arguments.format in ("mjcf", "urdf"):
        return _mend(arguments)
    if output:
        check_writable(output)
        kind = SETUP if arguments.format == "sensor" else EXPORT
        check_outputs({"--output": output}, [arguments.found], {"--output": kind}, arguments.force)
    text = _exported(arguments)
    if not output:
        print(text, end="")
    write_answers({output: lambda path: write_text(path, text)})
    return 0


def _exported(arguments: argparse.Namespace) -> str:
    if arguments.format in LAYOUTS:
        return layout(arguments.format)
    setup = found_setup(arguments)
    check_outputs({"--output": arguments.output}, setup.files)
    mass = arguments.sensor_mass
    if mass is not None and not (0 < mass[0] < 1000 and max(map(abs, mass[1:])) < 10):
        remedy = "give kg, and metres in the flange frame"
        raise UsageError(f"{' '.join(f'{x:g}' for x in mass)} is no mass", field="--sensor-mass", remedy=remedy)
    if arguments.format == "sensor":
        return sensor_file_text(setup, "export")
    options = ExportOptions(
        sensor_mass=None if mass is None else tuple(mass),
        frames_as_stated=arguments.frames_as_stated,
        sensor_frame=arguments.sensor_frame,
        world_frame=arguments.world_frame,
    )
    return export_text(setup, arguments.format, options)


def sensor_file_text(setup: Setup, by: str) -> str:
    """The text of a ``sensor_model.toml`` that a command writes."""
    from ftbias_jax.simulators.sensor_file import sensor_text

    return f"{WRITTEN_BY}{by}, which may replace it\n{sensor_text(setup)}"


def found_setup(arguments: argparse.Namespace) -> Setup:
    """The named setup, or the setup of a named diagnosis with its findings as effects."""
    found = arguments.found
    if not found:
        raise UsageError("needs a setup with the tool", field="SETUP.toml", remedy="name it")
    if not found.endswith(".json"):
        return load_setup(found, with_tool=True)
    if getattr(arguments, "format", "mjcf") not in OF_SIMULATORS:
        remedy = "give a setup: ftbias diagnose --apply -o FIXED.toml"
        raise UsageError(f"{found!r} is a diagnosis", field="SETUP.toml", remedy=remedy)
    if not arguments.setup:
        raise UsageError("a diagnosis needs its setup", field="--setup", remedy="name it: --setup SETUP.toml")
    from ftbias_jax.diagnosis.apply import with_causes
    from ftbias_jax.diagnosis.report.as_json import load_found

    causes, terms, _ = load_found(found)
    return with_causes(load_setup(arguments.setup, with_tool=True), causes, terms)


def _mend(arguments: argparse.Namespace) -> int:
    """Write a corrected scene or URDF, the sensor model, and the list of effects that neither can express."""
    if not (arguments.like and arguments.output):
        field = "--output" if arguments.like else "--like"
        raise UsageError("a file is mended in a copy of it", field=field, remedy="--like SCENE.xml -o MENDED.xml")
    setup, output = found_setup(arguments), arguments.output
    if arguments.format == "urdf":
        from ftbias_jax.simulators.mend_urdf import mend_urdf

        made = mend_urdf(setup, arguments.like, output, arguments.site)
    else:
        from ftbias_jax.simulators.mend_mjcf import mend_mjcf

        made = mend_mjcf(setup, scene_of(setup, arguments.like, arguments.site, arguments.base), output)
    folder = os.path.dirname(output)
    beside = {name: os.path.join(folder, name) for name in ("sensor_model.toml", NOT_EXPRESSED)}
    outputs = {"--output": output, **{path: path for path in list(made.files)[1:]}, **beside}
    kinds = {**dict.fromkeys(outputs, EXPORT), "sensor_model.toml": SETUP}
    for option, path in outputs.items():
        check_writable(path, option=option)
    check_outputs(outputs, [arguments.found, arguments.setup, arguments.like, *setup.files], kinds, arguments.force)
    for one in made.not_expressed:
        print(f"not expressed: {one['effect']}: {one['why']}")
    mark = f"\n<!-- mended by ftbias_jax {__version__} -->\n"  # by which it may be replaced
    texts = {path: text.rstrip() + mark for path, text in made.files.items()}
    texts[beside["sensor_model.toml"]] = sensor_file_text(setup, "export")
    answers: dict[str | None, Callable[[str], object]] = {
        path: partial(write_text, text=text) for path, text in texts.items()
    }
    write_answers({**answers, beside[NOT_EXPRESSED]: partial(write_json, content=made.not_expressed)})
    return 0


def scene_of(setup: Setup, path: str, site: str = "", base: str = "") -> Mjcf:
    """Load the scene at a path; its site and base default to those that the setup states."""
    return load_mjcf(path, site or setup.robot.site, base or setup.robot.base_link)
