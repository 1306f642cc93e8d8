"""Every command reads logs through the same repairs, reports each of them, and loses nothing that it does not report.

Every repairable fault is put into one simulated log of two joints, and every command reads it. The results must be
those of the log without the fault.
"""

import json
import re
import shlex
from typing import NamedTuple

import numpy as np
import pytest
import two_joints

import validation.__main__
from ftbias_jax.cli.main import main
from ftbias_jax.io import read_log
from ftbias_jax.io.write import npz
from ftbias_jax.setup import dump_setup, load_setup, parse_setup

RATE, SECONDS = 100, 20
SETUP = {**two_joints.SETUP, "bias": {"noise_density": [0.05, 2e-3]}}
FROZEN = slice(5 * RATE, 9 * RATE)
WITHIN = {"clipped": 12}
"""Standard errors by which a result may be off (default 4); near a limit the upper half of the noise is lost."""


class Fault(NamedTuple):
    """A fault, and the text that every command must print for it."""

    spoil: object
    """Function that takes a log as arrays and returns it with the fault."""
    told: str
    """The repair; COUNT stands for a number."""
    lost: bool


def stuck(log):
    log["wrench"][FROZEN, 2] = log["wrench"][FROZEN.start, 2]
    return log


def clipped(log):
    log["wrench"][:, 2] = np.minimum(log["wrench"][:, 2], np.quantile(log["wrench"][:, 2], 0.85))
    return log


def repeated(log):
    """Every tenth row is repeated, with wrong wrenches in the repeat."""
    twice = np.sort(np.r_[np.arange(len(log["t"])), np.arange(0, len(log["t"]), 10)])
    second = np.r_[False, twice[1:] == twice[:-1]]
    log = {name: values[twice] for name, values in log.items()}
    log["wrench"][second] += 7.0
    return log


def late(log):
    """Adjacent rows are swapped."""
    order = np.arange(len(log["t"]))
    order[100:200] = order[100:200].reshape(-1, 2)[:, ::-1].ravel()
    return {name: values[order] for name, values in log.items()}


def never(log):
    log["wrench"][:, 5] = np.nan
    return log


FAULTS = {
    "stuck": Fault(stuck, "fz stands still from 5.0 s to 9.0 s: 400 samples left out", True),
    "clipped": Fault(clipped, "samples at the end of the sensor's range left out: COUNT of fz", True),
    "repeated": Fault(repeated, "200 of the samples left out: their stamps are repeated", True),
    "late": Fault(late, "50 of the samples came late: put in order", False),
    "never": Fault(never, "never measured: tz", True),
}
every_fault = pytest.mark.parametrize("name", FAULTS)


@pytest.fixture(scope="module")
def simulated():
    return two_joints.simulated(SETUP, RATE, SECONDS)[0]


@pytest.fixture(scope="module")
def folder(simulated, tmp_path_factory):
    """A folder with the setup, the log without faults, and the log with each fault."""
    folder = tmp_path_factory.mktemp("faults")
    (folder / "setup.toml").write_text(dump_setup(parse_setup(SETUP)))
    np.savez(folder / "whole.npz", **simulated)
    for name, fault in FAULTS.items():
        np.savez(folder / f"{name}.npz", **fault.spoil({key: values.copy() for key, values in simulated.items()}))
    return folder


@pytest.fixture
def command(folder, monkeypatch, capsys):
    """Run a command line; return the exit code and what was printed."""
    monkeypatch.chdir(folder)

    def run(line, main=main):
        code = main(shlex.split(line))
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def assert_told(name, code, printed, raw=False):
    """Check exit code and text; ``raw`` for a command that keeps clipped samples as evidence."""
    fault = FAULTS[name]
    words, lost = fault.told, fault.lost
    if raw and name == "clipped":
        words, lost = words.replace(" left out", ""), False
    assert re.search(re.escape(words).replace("COUNT", r"\d+"), printed), printed
    assert code == (3 if lost else 0)


def tuned(path):
    """sigma_Q (6,) and its relative standard errors."""
    text = path.read_text()
    errors = re.search(r"noise_density = .*relative standard errors ([\d. e+-]+)", text)
    return load_setup(path).bias.noise_density, np.array(errors[1].split(), float)


@every_fault
def test_filter(command, folder, name):
    code, _, told = command(f"filter {name}.npz --setup setup.toml -o filtered.npz")
    assert_told(name, code, told)
    result, whole = npz.load_npz(folder / "filtered.npz"), read_log("whole.npz", load_setup("setup.toml"))
    axes = slice(0, 5) if name == "never" else slice(None)
    np.testing.assert_allclose(result["t"], whole.t)
    command("filter whole.npz --setup setup.toml -o unspoilt.npz")
    off = result["bias"] - npz.load_npz(folder / "unspoilt.npz")["bias"]
    assert (np.abs(off) / result["bias_std"])[-1, axes].max() < WITHIN.get(name, 4) / 4


@every_fault
def test_tune(command, folder, name):
    line = "tune {}.npz --setup setup.toml -o {}.toml --fit bias --tie pair --hold-out 0 --restarts 0"
    if not (folder / "tuned_whole.toml").exists():
        assert command(line.format("whole", "tuned_whole"))[0] == 0
    code, _, told = command(line.format(name, f"tuned_{name}"))
    assert_told(name, code, told)
    (expected, errors), (found, _) = tuned(folder / "tuned_whole.toml"), tuned(folder / f"tuned_{name}.toml")
    assert errors.max() < 0.5
    assert (np.abs(np.log(found / expected)) < WITHIN.get(name, 4) * errors).all()


@every_fault
def test_identify(command, folder, name):
    code, out, told = command(f"identify {name}.npz --setup setup.toml -o identified.toml")
    assert_told(name, code, told)
    mass, stderr = map(float, re.search(r"mass +(\S+) +(\S+)", out).groups())
    assert abs(mass - SETUP["tool"]["mass"]) < WITHIN.get(name, 4) * stderr
    assert stderr < 0.02


def test_a_setup_is_replaced_in_place_and_its_link_stays(command, folder):
    (folder / "own.toml").write_text((folder / "setup.toml").read_text())
    (folder / "link.toml").symlink_to("own.toml")
    code, out, _ = command("identify whole.npz --setup link.toml --in-place")
    assert code == 0
    assert out.endswith("wrote link.toml\n")
    assert (folder / "link.toml").is_symlink()
    assert "identified" in (folder / "own.toml").read_text()


@every_fault
def test_simulate(command, folder, simulated, name):
    code, _, told = command(f"simulate --setup setup.toml --motion {name}.npz -o made.npz --truth truth.npz")
    assert_told(name, code, told)
    truth = npz.load_npz(folder / "truth.npz")
    np.testing.assert_allclose(truth["t"], simulated["t"], atol=1e-9)
    np.testing.assert_allclose(truth["q"], simulated["q"], atol=0.01)


@every_fault
def test_info(command, name):
    code, out, _ = command(f"info {name}.npz")
    assert_told(name, code, out)
    assert "has 2 joints and a wrench" in out


@pytest.fixture
def seen(monkeypatch, make_diagnosis):
    """The logs that a diagnosis examines after leaving out bad samples; it returns a made-up diagnosis."""
    from ftbias_jax.diagnosis import diagnose as module

    kept = []

    class Seen(Exception):
        pass

    def look(setup, logs):
        kept.extend(logs)
        raise Seen

    monkeypatch.setattr(module, "compiled_ahead", look)
    real = module.diagnose

    def diagnose(setup, logs, names, without=(), unchecked=False, progress=str):
        try:
            real(setup, logs, names, without, unchecked=unchecked)
        except Seen:
            repairs = tuple(log.repairs for log in kept[-len(logs) :])
            return make_diagnosis()._replace(logs=tuple(names), repairs=repairs)
        raise AssertionError("the diagnosis did not look into the logs")

    monkeypatch.setattr(module, "diagnose", diagnose)
    monkeypatch.setattr("validation.runs.diagnose", diagnose)
    return kept


@every_fault
def test_diagnose(command, folder, simulated, seen, name):
    code, out, told = command(f"diagnose {name}.npz --setup setup.toml --json said.json")
    assert_told(name, code, told, raw=True)
    losses = json.loads((folder / "said.json").read_text())["losses"]
    assert (code == 3) == bool(losses) == ("lost: " in out)
    (log,) = seen
    expected = FAULTS[name].spoil({key: values.copy() for key, values in simulated.items()})["wrench"]
    if name in ("repeated", "late"):
        expected = simulated["wrench"]
    if name == "stuck":
        expected[FROZEN, 2] = np.nan
    np.testing.assert_array_equal(log.wrench, expected)


@every_fault
def test_validate(command, folder, seen, name):
    labelled = folder / f"set_{name}"
    labelled.mkdir()
    (labelled / "log_0.npz").write_bytes((folder / f"{name}.npz").read_bytes())
    (labelled / "log_0.toml").write_text((folder / "setup.toml").read_text())
    truth = {"effects": {"none": {}}, "gap_sigmas": 2.0, "sigma": SETUP["sensor"]["noise_std"]}
    (labelled / "truth.json").write_text(json.dumps({"log_0": truth}))
    code, _, told = command(f"score set_{name}", validation.__main__.main)
    lost = FAULTS[name].lost and name != "clipped"
    assert code == (3 if lost else 0)
    assert (FAULTS[name].told in told) == lost
