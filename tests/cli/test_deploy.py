"""The recipes for clusters: the command line accepts the commands that they run."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from ftbias_jax import __version__
from ftbias_jax.cli.main import build_parser

DEPLOY = Path(__file__).parents[2] / "docs" / "deploy"


def commands(name):
    """Calls of ftbias in a recipe, with a number for whatever the shell fills in."""
    text = re.sub(r"\\\n", " ", (DEPLOY / name).read_text())
    text = re.sub(r"\n\s+--distributed", " --distributed", text)
    calls = re.findall(r"^(?!\s*#).*?\bftbias ((?:filter|tune) .*)$", text, re.M)
    return [re.sub(r"\$\(\(.*?\)\)|\$\{.*?\}|\$\w+", "1", call).removesuffix("&") for call in calls]


@pytest.mark.parametrize(("name", "count"), [("slurm_filter.sh", 1), ("kubernetes.yaml", 2)])
def test_the_commands_of_a_recipe_are_understood(name, count):
    found = commands(name)
    assert len(found) == count
    for call in found:
        parsed = build_parser().parse_args(shlex.split(call))
        assert parsed.command in ("filter", "tune")
        assert parsed.shard if parsed.command == "filter" else parsed.distributed


def test_the_slurm_script_is_a_script():
    subprocess.run(["bash", "-n", DEPLOY / "slurm_filter.sh"], check=True)


def test_images_have_the_version_of_the_package():
    images = re.findall(r"ftbias:([0-9][\w.]*)", "".join(path.read_text() for path in DEPLOY.iterdir()))
    assert set(images) == {__version__}
    assert len(images) == 4
