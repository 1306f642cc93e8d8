"""A setup drafted from a robot's name, a URDF or a log: everything they tell, and what is left to measure."""

from __future__ import annotations

import os
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ftbias_jax.errors import UsageError
from ftbias_jax.io import is_ros, read_recorded
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.conventions.axes import sensor_rotations
from ftbias_jax.io.draft.gravity import Weighed, weigh
from ftbias_jax.io.draft.noise import quietest_noise
from ftbias_jax.io.draft.recording import look_into, sensor_frame
from ftbias_jax.io.draft.robot import Keys, built_in, from_urdf, mounting, robots_with
from ftbias_jax.setup.keys.template import MEASURE, Known, write_template
from ftbias_jax.setup.parse import parse_setup
from ftbias_jax.setup.types import Setup
from ftbias_jax.setup.urdf import load_urdf

GUESS = Known([0.1, 0.004], f"a guess: {MEASURE}")
"""N, Nm: noise of a usual wrist sensor, where there is no log to look at."""
ABOUT = """Setup of a robot with a force-torque sensor, drafted by ftbias setup{source}.
What says "{measure}" is not known; lines behind a # show other keys with their defaults.
Next: ftbias info LOG --setup {file}; without the tool's mass also ftbias identify LOG --setup {file} -o FOUND.toml"""


class Request(NamedTuple):
    """What somebody asks for."""

    log: str = ""
    robot: str = ""
    """Name of a built-in one."""
    urdf: str = ""
    base_link: str = ""
    tip_link: str = ""
    mass: float | None = None
    """kg."""
    center_of_mass: Sequence[float] | None = None
    """(3,) m, sensor frame."""
    output: str = "setup.toml"


class Draft(NamedTuple):
    """A setup's text, and what goes with it."""

    text: str
    urdf: str
    """Text of a URDF that the recording had, to be written beside the setup; "" = none."""
    notes: tuple[str, ...]
    """A line each: what was found out, and what was not."""


def draft(request: Request) -> Draft:
    """Draft a setup.

    Raises:
        UsageError: it is not said which robot, or in two ways. LogError, SetupError: a file cannot be read.
    """
    if request.robot and request.urdf:
        raise UsageError("the robot is named twice", field="--robot, --urdf", remedy="remove one of the two")
    with _folder(request) as folder:
        keys, urdf = _robot(request, folder)
        if request.mass is not None:
            keys["tool.mass"] = Known(request.mass, "as stated")
        if request.center_of_mass is not None:
            keys["tool.center_of_mass"] = Known(list(request.center_of_mass), "as stated")
        keys.setdefault("sensor.noise_std", GUESS)
        notes: list[str] = []
        if request.log:
            found, notes = _of_log(_parsed(keys, folder, request), request.log)
            keys |= {key: known for key, known in found.items() if key not in keys or keys[key] is GUESS}
        text = write_template(keys, _about(request))
        setup = parse_setup(tomllib.loads(text), os.path.join(folder, Path(request.output).name))
    notes += [f"not known: {', '.join(f'tool.{key}' for key in setup.tool.unknown)}"] if setup.tool.unknown else []
    return Draft(text, urdf, tuple(notes))


def urdf_beside(output: str) -> str:
    """The file for a recording's URDF."""
    return str(Path(output).with_suffix(".urdf"))


@contextmanager
def _folder(request: Request) -> Iterator[str]:
    """Where relative paths of the setup start; for a recording, whose URDF is not written yet, another one."""
    if request.robot or request.urdf:
        yield os.path.dirname(os.path.abspath(request.output))
        return
    with tempfile.TemporaryDirectory() as folder:
        yield folder


def _robot(request: Request, folder: str) -> tuple[Keys, str]:
    """Keys of robot, mounting and topics, and the URDF that the recording has if it is needed."""
    links = (request.base_link, request.tip_link)
    if not (request.log and is_ros(request.log)):
        if request.urdf:
            return from_urdf(request.urdf, *links, folder), ""
        return built_in(_named(request, ())), ""
    recorded = look_into(request.log)
    urdf = "" if request.robot or request.urdf else recorded.description
    if not request.urdf and not urdf:
        model = built_in(_named(request, recorded.joints), recorded.joints)
        return {**model, **sensor_frame(recorded), **recorded.keys}, ""
    path = request.urdf
    if urdf:
        path = os.path.join(folder, Path(urdf_beside(request.output)).name)
        Path(path).write_text(urdf, encoding="utf-8")
    keys = from_urdf(path, *links, folder)
    mounted = mounting(load_urdf(path), str(keys["robot.tip_link"].value), recorded.frame) if recorded.frame else {}
    return {**keys, **(mounted or sensor_frame(recorded)), **recorded.keys}, urdf


def _named(request: Request, recorded: Sequence[str]) -> str:
    """The built-in robot that is meant."""
    if request.robot:
        return request.robot
    found = robots_with(recorded)
    if len(found) == 1:
        return found[0]
    words = f"the joints are those of {', '.join(found)}" if found else "which robot is it?"
    raise UsageError(words, field="--robot", remedy="name a built-in robot, or give --urdf FILE")


def _parsed(keys: Keys, folder: str, request: Request) -> Setup:
    file = os.path.join(folder, Path(request.output).name)
    return parse_setup(tomllib.loads(write_template(keys)), file)


def _about(request: Request) -> str:
    source = f" from {Path(request.log).name}" if request.log else ""
    return ABOUT.format(source=source, measure=MEASURE, file=Path(request.output).name)


def _of_log(setup: Setup, path: str) -> tuple[Keys, list[str]]:
    """What the samples of a log tell: the noise of the sensor, its sign, and the tool by its weight."""
    log = clean(read_recorded(path, setup, salvage=True), file=path)
    keys, notes = {}, []
    noise = quietest_noise(log.t, log.wrench)
    if noise:
        keys["sensor.noise_std"] = Known(noise, "of the quietest second of the log")
    rotations = sensor_rotations(log.t, log.q, setup, path)
    found = weigh(log.t, rotations, setup.robot.gravity, log.wrench)
    if found is None:
        notes.append("the sensor is not turned in this log, so its weight shows nothing of the tool")
    elif not found.credible:
        notes.append(f"the weight that the log shows is not credible: {_words(found)}")
    else:
        keys |= _tool(found)
        notes.append(f"weighed by the log: {_words(found)}")
    return keys, notes


def _words(found: Weighed) -> str:
    return f"{abs(found.mass):.3g} \u00b1 {found.mass_stderr:.2g} kg, which leaves {found.residual:.2g} N of the forces"


def _tool(found: Weighed) -> Keys:
    remark = f"by its weight in the log; {MEASURE}"
    keys = {
        "tool.mass": Known(float(f"{abs(found.mass):.4g}"), f"\u00b1 {found.mass_stderr:.2g} {remark}"),
        "tool.center_of_mass": Known([round(float(x), 4) for x in found.center_of_mass], remark),
    }
    if found.mass < 0:
        keys["sensor.reports"] = Known("wrench_on_sensor", "because the weight has the opposite sign")
    return keys
