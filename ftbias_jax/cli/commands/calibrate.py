"""``ftbias calibrate``: a setup from logs, each step of which must improve predictions of held-out data."""

import argparse
from pathlib import Path

from ftbias_jax.cli.given import logs_of, setup_of, start_jax, write_answers
from ftbias_jax.cli.terminal import print_repairs
from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.find import expand
from ftbias_jax.io import or_poses, read_log
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.draft.draft import Request, urdf_beside
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.io.write.outputs import CALIBRATION, PAGE, SETUP, refuse_existing
from ftbias_jax.runtime.progress import Stages
from ftbias_jax.setup import Setup
from ftbias_jax.setup.save import write_text


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, and write the setup; returns 3 if samples of a log were lost, else 0."""
    drafts = arguments.setup is None
    if not drafts and (arguments.robot or arguments.urdf):
        raise UsageError("the setup states the robot", field="--robot, --urdf", remedy="leave out one of the two")
    with Stages("calibrating") as stages:
        stages("drafting a setup" if drafts else "reading")
        setup, urdf = _draft(arguments) if drafts else (setup_of(arguments), "")
        kinds = {"--output": SETUP, "--html": PAGE, "--json": CALIBRATION}
        paths = logs_of(arguments, setup, kinds, stated=(setup.description,) if drafts else None)
        logs = [or_poses(read_log, path, setup, raw=True) for path in paths]
        start_jax()
        from ftbias_jax.calibration.identify_tool import identify_tool
        from ftbias_jax.commissioning.calibrate import calibrate
        from ftbias_jax.commissioning.result import plain_of_poses, poses_to_html

        asked = {"bias": arguments.bias, "unchecked": arguments.unchecked, "progress": stages}
        poses = [log for log in logs if isinstance(log, Poses)]
        motions = [log for log in logs if isinstance(log, Log)]
        if poses:
            if len(paths) > 1:
                message = "static poses are not calibrated together with another log"
                raise UsageError(message, field="logs", remedy="give one table of poses, or logs of motion")
            tool = identify_tool(setup, poses[0], **asked)
        else:
            names = [Path(path).name for path in paths]
            found = calibrate(setup, motions, names, hold_out=arguments.hold_out, **asked)
    answer = tool if poses else found
    print(answer)
    beside = urdf_beside(arguments.output) if urdf else None
    write_answers(
        {
            beside: lambda path: write_text(path, urdf),
            arguments.output: lambda path: answer.save(path, by="calibrate"),
            arguments.html: lambda path: poses_to_html(tool, path) if poses else found.to_html(path),
            arguments.json: lambda path: write_json(path, plain_of_poses(tool) if poses else found.plain()),
        }
    )
    return print_repairs(zip(paths, [poses[0].repairs] if poses else found.repairs, strict=True))


def _draft(arguments: argparse.Namespace) -> tuple[Setup, str]:
    """Setup drafted from the first log, and the text of the URDF that the log contains."""
    from ftbias_jax.commissioning.drafted import checked_draft

    logs = expand(arguments.logs, {})
    request = Request(logs=logs[:1], robot=arguments.robot, urdf=arguments.urdf, output=arguments.output)
    drafted = checked_draft(request)
    if drafted.urdf:
        refuse_existing(urdf_beside(arguments.output))
    return drafted.setup, drafted.urdf
