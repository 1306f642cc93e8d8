"""Peak memory of ``ftbias filter`` for logs of a million and of ten million samples."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ftbias_jax.cli.commands.demo import SETUP
from ftbias_jax.setup import dump_setup, parse_setup

JOINTS, INTERVAL = 7, 1e-3
FILTER = "import sys; from ftbias_jax.cli.main import main; sys.exit(main())"


def write_log(path, samples, dtype):
    """Write a log with sines of every joint, slow waves of the wrench, and typical noise of encoders and sensor."""
    rng = np.random.default_rng(0)
    t = np.arange(samples) * INTERVAL
    q, dq, wrench = (np.empty((samples, width), dtype) for width in (JOINTS, JOINTS, 6))
    for j, rate in enumerate(2 * np.pi * rng.uniform(0.05, 0.2, JOINTS)):
        q[:, j] = 0.4 * np.sin(rate * t) + 2e-5 * rng.standard_normal(samples)
        dq[:, j] = 0.4 * rate * np.cos(rate * t) + 1e-3 * rng.standard_normal(samples)
    for i, size in enumerate(np.repeat([1.0, 0.04], 3)):
        wrench[:, i] = size * (np.sin(0.01 * (i + 1) * t) + 0.1 * rng.standard_normal(samples))
    np.savez(path, t=t, q=q, dq=dq, wrench=wrench)


def measure(folder, samples, dtype):
    log, setup, output = folder / "log.npz", folder / "setup.toml", folder / "out.npz"
    setup.write_text(dump_setup(parse_setup(SETUP)))
    # The log is written by a separate process, so that its memory does not count towards the peak of the filter.
    writer = f"import numpy, run, pathlib; run.write_log(pathlib.Path({str(log)!r}), {samples}, numpy.{dtype})"
    subprocess.run([sys.executable, "-c", writer], check=True, cwd=Path(__file__).parent)
    started = time.perf_counter()
    command = [sys.executable, "-c", FILTER, "filter", str(log), "--setup", str(setup), "-o", str(output)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = status
    assert status == 0
    result = {
        "samples": samples,
        "stored_as": dtype,
        "log_MB": round(log.stat().st_size / 1e6),
        "result_MB": round(output.stat().st_size / 1e6),
        "peak_memory_MB": round(usage.ru_maxrss * 1024 / 1e6),
        "seconds": round(time.perf_counter() - started),
    }
    return result


if __name__ == "__main__":
    results = []
    for samples in (10**6, 10**7):
        for dtype in ("float32", "float64"):
            with tempfile.TemporaryDirectory() as folder:
                results.append(measure(Path(folder), samples, dtype))
            print(results[-1], flush=True)
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from common import keep  # imported late, because the memory of JAX would count towards the measured process

    keep(__file__, results)
