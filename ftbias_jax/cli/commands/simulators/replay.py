"""``ftbias replay``: wrench that a MuJoCo scene predicts for a log. ``ftbias validate-sim``: its errors on new logs."""

import argparse
from pathlib import Path

import numpy as np

from ftbias_jax.cli.commands.simulators.export import found_setup, scene_of
from ftbias_jax.cli.given import logs_of, setup_of, start_jax, write_answers
from ftbias_jax.cli.terminal import print_repairs
from ftbias_jax.errors import SetupError, UsageError
from ftbias_jax.io import read_log
from ftbias_jax.io.atomic import write_json
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.write.npz import save_npz, texts_of_log
from ftbias_jax.io.write.outputs import LOG, SCORE
from ftbias_jax.io.write.provenance import provenance, source_of
from ftbias_jax.runtime.progress import Progress, Stages
from ftbias_jax.setup import Setup
from ftbias_jax.setup.mjcf import Mjcf
from ftbias_jax.setup.types import sign_of


def scene_at_sensor(setup: Setup, path: str) -> Mjcf:
    """Load a scene whose site is at the setup's sensor; "" = the scene of the setup itself.

    Raises:
        SetupError: the setup places the sensor away from the site. UsageError: neither path nor setup names a scene.
    """
    path = path or (setup.description if setup.description.endswith(".xml") else "")
    if not path:
        raise UsageError("nothing names the scene", field="--mjcf", remedy="give --mjcf SCENE.xml")
    if setup.sensor.translation.any() or not np.allclose(setup.sensor.rotation, np.eye(3)):
        remedy = "put the site where the sensor is, and leave translation and rotation_rpy out"
        raise SetupError("the sensor is beside the scene's site", file=setup.path, field="sensor", remedy=remedy)
    return scene_of(setup, path)


def run(arguments: argparse.Namespace) -> int:
    """Write the wrench that the scene predicts; returns 3 if samples of the log were lost, else 0."""
    setup = setup_of(arguments)
    (path,) = logs_of(arguments, setup, {"--output": LOG}, stated=(*setup.files, arguments.mjcf))
    scene, log = scene_at_sensor(setup, arguments.mjcf), read_log(path, setup)
    start_jax()
    from ftbias_jax.simulators.replay import joint_states, replay

    log = clean(log)
    states = joint_states(setup, log)
    wrench = replay(scene, log.t, states, Progress("replaying", len(log.t)))
    q, dq, ddq = np.moveaxis(states, 2, 0)
    arrays = {
        "t": log.t + log.start,
        "wrench_model": sign_of(setup.sensor.reports) * wrench,
        "q": q,
        "dq": dq,
        "ddq": ddq,
    }
    origin = provenance(setup, [source_of(log)], {"replayed": Path(scene.file).name}, [Path(path).name])
    save_npz(arguments.output, arrays | texts_of_log(arrays, setup.sensor.reports, origin))
    print(f"wrote {arguments.output}")
    return print_repairs([(path, log.repairs)])


def validate(arguments: argparse.Namespace) -> int:
    """Compare logs with a scene before and after its correction; returns 3 if samples were lost, else 0."""
    setup, mended = setup_of(arguments), found_setup(arguments)
    kinds = {"--json": SCORE}
    paths = logs_of(arguments, setup, kinds, stated=(*setup.files, arguments.like, arguments.mended))
    scenes = scene_at_sensor(setup, arguments.like), scene_of(setup, arguments.mended)
    with Stages("validating") as stages:
        stages("reading")
        logs = [read_log(path, setup, raw=True) for path in paths]
        start_jax()
        from ftbias_jax.simulators.validate import validate as compare

        found = compare(setup, mended, logs, scenes, stages)
    print(found)

    def write(path: str) -> None:
        origin = provenance(setup, list(map(source_of, logs)), {}, [Path(path).name for path in paths])
        write_json(path, {"versions": origin["version"], "logs": origin["logs"], **found.plain()})

    write_answers({arguments.json: write})
    return print_repairs((path, log.repairs) for path, log in zip(paths, logs, strict=True))
