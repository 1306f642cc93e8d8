"""``ftbias sample``: draw many simulators that are consistent with the data, to train on."""

import argparse
import os

import numpy as np

from ftbias_jax.cli.commands.simulators.export import scene_of, sensor_file_text
from ftbias_jax.errors import UsageError
from ftbias_jax.io.atomic import make_folder, write_json
from ftbias_jax.io.write.outputs import check_outputs
from ftbias_jax.runtime.progress import Progress
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.save import write_text

RANGES = "ranges.json"


def run(arguments: argparse.Namespace) -> int:
    """Write the samples into a folder; returns 0."""
    folder = arguments.output
    if os.path.isdir(folder) and os.listdir(folder) and not arguments.force:
        raise UsageError(f"{folder!r} is not empty", field="--output", remedy="name a new folder, or add --force")
    setup = load_setup(arguments.setup, with_tool=True)
    from ftbias_jax.diagnosis.apply import with_causes
    from ftbias_jax.diagnosis.report.as_json import load_found
    from ftbias_jax.model.own_effects import catalogue_of_setup
    from ftbias_jax.simulators.mend_mjcf import mend_mjcf
    from ftbias_jax.simulators.sample import draw, posterior_of, ranges, with_rest

    causes, terms, content = load_found(arguments.found)
    posterior = posterior_of(causes, content, catalogue_of_setup(setup), arguments.found)
    setup = with_rest(setup, content)
    names = [f"{i:03d}" for i in range(arguments.count)]
    places = {name: os.path.join(folder, f"{name}_sensor.toml") for name in names}
    check_outputs(places, [arguments.found, arguments.setup, arguments.like, *setup.files], force=True)
    scene = scene_of(setup, arguments.like) if arguments.like else None
    make_folder(folder)
    random, progress, draws = np.random.default_rng(arguments.seed), Progress("sampling", len(names)), []
    for i, name in enumerate(names):
        draws.append(draw(posterior, random))
        drawn = with_causes(setup, draws[-1], terms)
        write_text(places[name], sensor_file_text(drawn, "sample"))
        mended = mend_mjcf(drawn, scene, os.path.join(folder, f"{name}.xml")).files if scene else {}
        for path, text in mended.items():
            write_text(path, text)
        progress(i + 1)
    write_json(os.path.join(folder, RANGES), ranges(posterior, draws))
    print(f"wrote {len(names)} samples and {RANGES} into {folder}")
    return 0
