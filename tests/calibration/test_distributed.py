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

from ftbias_jax.calibration import tune
from ftbias_jax.cli.main import build_parser
from ftbias_jax.types import Sample

TIES = dict.fromkeys(tune.JOINT_NAMES, "each")
PROGRAM = """
import json, pickle, sys
import jax
jax.config.update("jax_enable_x64", True)
from ftbias_jax.calibration import distributed, tune
coordinator, process, file, ties = sys.argv[1], int(sys.argv[2]), sys.argv[3], json.loads(sys.argv[4])
distributed.start(coordinator, 2, process)
with open(file, "rb") as opened:
    params, logs = pickle.load(opened)
mine = [logs[int(i)] for i in distributed.share([str(i) for i in range(len(logs))])]
_, fit = tune.tune_joints(params, mine, ties, total=distributed.total)
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


def test_two_processes_find_the_optimum_of_one(params, tmp_path):
    logs = [moving_joints(seed, count) for seed, count in enumerate((300, 250, 280))]
    file = tmp_path / "problem.pickle"
    file.write_bytes(pickle.dumps((jax.tree.map(np.asarray, params), logs)))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        coordinator = f"127.0.0.1:{free.getsockname()[1]}"
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM, coordinator, str(i), str(file), json.dumps(TIES)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        for i in range(2)
    ]
    try:
        outputs = [process.communicate(timeout=300) for process in processes]
    finally:
        for process in processes:
            process.kill()
    assert [process.returncode for process in processes] == [0, 0], outputs
    (first, *found), (second, *other) = (json.loads(out.splitlines()[-1]) for out, _ in outputs)
    assert (first, second) == (2, 1)  # logs of each
    assert found == other
    _, fit = tune.tune_joints(jax.tree.map(jnp.asarray, params), logs, TIES)
    for values, name in zip(found, TIES, strict=True):
        np.testing.assert_allclose(values, fit.values[name], rtol=1e-8)


@pytest.mark.parametrize("text", ["host,2,0", "host:1,2,2", "host:1,2", "host:1,2,x"])
def test_a_wrong_process_is_a_usage_error(text, capsys):
    with pytest.raises(SystemExit) as stopped:
        build_parser().parse_args(["tune", "log.npz", "--setup", "s.toml", "-o", "t.toml", "--distributed", text])
    assert stopped.value.code == 2
    assert "HOST:PORT,N,I" in capsys.readouterr().err
