"""Two processes on this machine tune together and find what one process finds."""

import json
import os
import pickle
import socket
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import ftbias_jax
from ftbias_jax.calibration import tune
from ftbias_jax.calibration.noise.values import JOINT_NAMES
from ftbias_jax.cli.main import build_parser
from ftbias_jax.types import Sample

TIES = dict.fromkeys(JOINT_NAMES, "each")
PROGRAM = """
import json, pickle, sys
import jax
jax.config.update("jax_enable_x64", True)
from ftbias_jax.calibration import distributed, newton, tune
coordinator, process, file, ties = sys.argv[1], int(sys.argv[2]), sys.argv[3], json.loads(sys.argv[4])
distributed.start(coordinator, 2, process)
with open(file, "rb") as opened:
    params, logs = pickle.load(opened)
mine = [logs[int(i)] for i in distributed.share([str(i) for i in range(len(logs))])]
_, fit = tune.tune_joints(params, mine, ties, search=newton.Search(total=distributed.total))
print(json.dumps([len(mine), *(fit.values[name].tolist() for name in ties)]))
"""


def moving_joints(seed, count):
    """Joints that the joint filter's model describes: noise on the jerk, integrated three times."""
    rng = np.random.default_rng(seed)
    dt = np.r_[0.0, rng.uniform(0.004, 0.006, count - 1)]
    ddq = np.cumsum(5.0 * np.sqrt(dt)[:, None] * rng.normal(size=(count, 3)), 0)
    dq = np.cumsum(dt[:, None] * ddq, 0)
    q = np.cumsum(dt[:, None] * dq, 0)
    noisy = (q + 1e-4 * rng.normal(size=q.shape), dq + 2e-3 * rng.normal(size=q.shape))
    return Sample(dt, *noisy, np.full((count, 6), np.nan))


def run_both(arguments, environment=None):
    """Return codes, standard outputs and errors of two processes; the arguments of each follow from its number."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{free.getsockname()[1]}"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", *arguments(coordinator, i)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "JAX_PLATFORMS": "cpu", **(environment or {})},
        )
        for i in range(2)
    ]
    try:
        outputs = [process.communicate(timeout=300) for process in processes]
    finally:
        for process in processes:
            process.kill()
    return [(process.returncode, *texts) for process, texts in zip(processes, outputs, strict=True)]


def test_two_processes_find_the_optimum_of_one(params, tmp_path):
    logs = [moving_joints(seed, count) for seed, count in enumerate((300, 250, 280))]
    file = tmp_path / "problem.pickle"
    file.write_bytes(pickle.dumps((jax.tree.map(np.asarray, params), logs)))
    ended = run_both(lambda coordinator, i: [PROGRAM, coordinator, str(i), str(file), json.dumps(TIES)])
    assert [code for code, *_ in ended] == [0, 0], ended
    (first, *found), (second, *other) = (json.loads(out.splitlines()[-1]) for _, out, _ in ended)
    assert (first, second) == (2, 1)  # logs of each
    assert found == other
    _, fit = tune.tune_joints(jax.tree.map(jnp.asarray, params), logs, TIES)
    for values, name in zip(found, TIES, strict=True):
        np.testing.assert_allclose(values, fit.values[name], rtol=1e-8)


def test_every_process_ends_in_one_line_if_one_has_no_log_it_can_use(logs):
    """The first has two logs, one of them good, the second has one that cannot be read."""
    for name in ("b.npz", "day/a.npz"):
        (logs / name).write_bytes(b"no log")
    program = "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"
    line = ["tune", "logs", "--setup", "setup.toml", "-o", "tuned.toml", "--distributed"]
    path = os.path.dirname(os.path.dirname(ftbias_jax.__file__))
    ended = run_both(lambda coordinator, i: [program, *line, f"{coordinator},2,{i}"], {"PYTHONPATH": path})
    for code, _, told in ended:
        lines = [line for line in told.splitlines() if line.startswith(("ftbias: ", "warning: "))]
        assert code == 1, ended
        assert lines[-1].startswith("ftbias: --distributed: 1 of 3 logs can be used, by 2 processes")
        assert lines[0].startswith("warning: left out: logs/")
        assert "Traceback" not in told
    assert not os.path.exists("tuned.toml")


@pytest.mark.parametrize("text", ["host,2,0", "host:1,2,2", "host:1,2", "host:1,2,x"])
def test_a_wrong_process_is_a_usage_error(text, capsys):
    with pytest.raises(SystemExit) as stopped:
        build_parser().parse_args(["tune", "log.npz", "--setup", "s.toml", "-o", "t.toml", "--distributed", text])
    assert stopped.value.code == 2
    assert "HOST:PORT,N,I" in capsys.readouterr().err
