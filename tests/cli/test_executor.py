"""An archive filtered by the workers of a Dask cluster, one of which is killed in the middle."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from small_archive import filter_archive, manifest, outputs

import ftbias_jax as ft


def started(module, *arguments):
    words = [sys.executable, "-m", module, *arguments]
    return subprocess.Popen(words, stderr=subprocess.PIPE, text=True, cwd="/")  # not where the command is run


@pytest.fixture
def cluster():
    """Address of a scheduler with two workers, and the processes of the workers."""
    scheduler = started("distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard")
    address = next(line.split()[-1] for line in scheduler.stderr if "Scheduler at:" in line)
    plain = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
    workers = [started("distributed.cli.dask_worker", address, *plain) for _ in range(2)]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()
        process.stderr.close()


@pytest.mark.slow
def test_workers_of_a_cluster_do_what_this_process_does(logs, cluster):
    address, workers = cluster
    assert filter_archive("logs") == 0
    alone, done = outputs(), [(entry.output, entry.status) for entry in manifest()]
    for path in (logs.parent / "out").rglob("*.npz"):
        path.unlink()
    for _ in workers[:1]:
        next(line for line in workers[0].stderr if "Registered to" in line)
    assert filter_archive("logs", "--executor", f"dask:{address}") == 0
    assert [(entry.output, entry.status) for entry in manifest()] == done
    for name, arrays in outputs().items():
        np.testing.assert_allclose(arrays["bias"], alone[name]["bias"], rtol=1e-6, atol=1e-12)


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_no_log(logs, cluster):
    from distributed import Client

    address, workers = cluster
    setup = ft.load_setup("setup.toml")
    paths = sorted(map(str, logs.rglob("*.npz"))) * 6
    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)
        executor = client.get_executor(pure=False)

        def progress(samples):
            if workers[0].poll() is None:
                os.kill(workers[0].pid, signal.SIGKILL)

        results = ft.filter_log(setup, paths, fields=["bias"], executor=executor, progress=progress)
    assert workers[0].wait(10) == -signal.SIGKILL
    assert len(results) == len(paths)
    assert not results.errors
    alone = ft.filter_log(setup, paths[0], fields=["bias"])
    np.testing.assert_allclose(results[0].bias, alone.bias, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(results[0].bias, results[len(paths) // 6].bias)
