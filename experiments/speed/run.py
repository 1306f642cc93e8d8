"""Speed of the pipeline against other libraries and a scalar loop, on one core; results must agree before timing.

Needs numba and those of dynamax, cuthbert, statsmodels, filterpy, simdkalman, pykalman that are to be compared.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
CORE = {max(os.sched_getaffinity(0))}
os.sched_setaffinity(0, CORE)

import common
import jax
import jax.numpy as jnp
import loop
import numpy as np
import others
from made_logs import PARAMS, RATE, cast, make_log, make_logs

from ftbias_jax.filtering import bias_filter, likelihood, pipeline
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.process_models import bias_drift_noise, drift_noise
from ftbias_jax.types import Sample

LENGTH, LOGS, LOG_LENGTH, SLOW_LENGTH, CHUNK = 60_000, 64, 4096, 2000, 1 << 14
SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
ROUNDS = 5
OPTIONS = pipeline.DEFAULT_OPTIONS


def whole(params, samples):
    """Return the log-likelihood, and the mean of bias and drift at every sample."""
    _, track = stages.run(params, pipeline.init(params, samples), samples, OPTIONS)
    return track.joint.log_likelihood.sum() + track.wrench.log_likelihood.sum(), track.wrench.mean


def with_noise(params, noise):
    density, position, velocity, sigma_Q, variance = noise
    joint = params.joint._replace(process_density=density, position_std=position, velocity_std=velocity)
    return params._replace(joint=joint, bias=params.bias._replace(density=sigma_Q, wrench_variance=variance))


def noise_of(params):
    joint = params.joint
    return (
        joint.process_density,
        joint.position_std,
        joint.velocity_std,
        params.bias.density,
        params.bias.wrench_variance,
    )


def score(params, samples):
    return likelihood.log_likelihood(params, samples, OPTIONS)


def gradient(params, samples):
    """Log-likelihood and its gradient with respect to all noise parameters."""
    return jax.value_and_grad(lambda noise: score(with_noise(params, noise), samples))(noise_of(params))


def bias_inputs(params, dt, y):
    samples = Sample(dt, None, None, jnp.zeros_like(y))
    state = pipeline.State(None, bias_filter.init(params.bias))
    return stages.bias_inputs(params, state, samples, y, jnp.broadcast_to(params.bias.wrench_variance, y.shape))


def bias_alone(params, dt, y):
    track = filter_scan(drift_noise, bias_inputs(params, dt, y))
    return track.mean[-1].reshape(-1), track.log_likelihood.sum()


def bias_gradient(params, dt, y):
    def nats(noise):
        bias = params.bias._replace(density=noise[0], wrench_variance=noise[1])
        return bias_alone(params._replace(bias=bias), dt, y)[1]

    return jax.value_and_grad(nats)((params.bias.density, params.bias.wrench_variance))


def compiled(function, *arguments):
    """Compile a function for its arguments; return it as one without arguments, and the compile time in s."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return (lambda: jax.block_until_ready(program(*arguments))), time.perf_counter() - start


def cpu_seconds(function):
    start = time.process_time()
    function()
    return time.process_time() - start


def compare():
    logs = make_logs(LOGS, LOG_LENGTH)
    log = make_log(LENGTH)
    y = jnp.asarray(stages.run(PARAMS, pipeline.init(PARAMS, log), log, OPTIONS)[1].wrench_tool - log.wrench)
    contestants, compile_seconds, absent, agreement = {}, {}, {}, {}

    def ours(name, samples, function, *arguments):
        run, compile_seconds[name] = compiled(function, *arguments)
        contestants[name] = (run, samples)
        return run

    for dtype in (jnp.float64, jnp.float32):
        params, one, many = cast((PARAMS, log, logs), dtype)
        bits = jnp.dtype(dtype).name
        ours(f"pipeline, {bits}", LENGTH, whole, params, one)
        ours(f"likelihood, {bits}", LENGTH, score, params, one)
        ours(f"gradient, {bits}", LENGTH, gradient, params, one)
        ours(f"bias filter, {bits}", LENGTH, bias_alone, params, one.dt, y.astype(dtype))
        ours(f"bias gradient, {bits}", LENGTH, bias_gradient, params, one.dt, y.astype(dtype))
        size = LOGS * LOG_LENGTH
        ours(f"64 logs, {bits}", size, jax.vmap(whole, (None, 0)), params, many)
        ours(f"64 logs likelihood, {bits}", size, lambda p, x: jax.vmap(score, (None, 0))(p, x).sum(), params, many)

        def summed(params, many):
            def total(noise):
                return jax.vmap(lambda x: score(with_noise(params, noise), x))(many).sum()

            return jax.value_and_grad(total)(noise_of(params))

        ours(f"64 logs gradient, {bits}", size, summed, params, many)

    constants = loop.arguments(PARAMS)
    columns = [np.asarray(x) for x in log[:4]]
    many = [np.asarray(x) for x in logs[:4]]
    means = np.zeros((LENGTH, 2, 6))
    run_loop = lambda: loop.filter_log(*columns, *constants, means)  # noqa: E731
    start = time.perf_counter()
    nats = run_loop()
    compile_seconds["loop"] = time.perf_counter() - start
    expected = contestants["pipeline, float64"][0]()
    agreement["loop"] = difference((nats, means), expected)
    contestants["loop"] = (run_loop, LENGTH)

    def loop_over_logs():
        for i in range(LOGS):
            loop.filter_log(*(x[i] for x in many), *constants, means[:LOG_LENGTH])

    contestants["loop, 64 logs"] = (loop_over_logs, LOGS * LOG_LENGTH)

    A, Q = (np.asarray(x) for x in bias_drift_noise(jnp.asarray(RATE), PARAMS.bias.density))
    R, prior = np.diag(PARAMS.bias.wrench_variance), np.diag(PARAMS.bias.prior_std**2)
    matrices = (A, Q, np.eye(6, 12), R, np.asarray(PARAMS.bias.prior_mean), prior)
    for name, make in {**others.LIBRARIES, **others.OTHER_RESULTS}.items():
        length = SLOW_LENGTH if name in others.SLOW else LENGTH
        part = y[:length] if name.startswith(("dynamax", "cuthbert")) else np.asarray(y[:length])
        try:
            function = make(*matrices)
            start = time.perf_counter()
            found = jax.block_until_ready(function(part))
            compile_seconds[name] = time.perf_counter() - start
        except ImportError as error:
            absent[name] = str(error)
            continue
        if name in others.LIBRARIES:
            agreement[name] = difference(found, bias_alone(PARAMS, log.dt[:length], y[:length]))
        contestants[name] = ((lambda f=function, x=part: jax.block_until_ready(f(x))), length)
    print(json.dumps(agreement, indent=1))
    assert max(agreement.values()) < 1e-8, "results differ: nothing is timed"

    best = dict.fromkeys(contestants, np.inf)
    for _ in range(ROUNDS):
        for name, (function, count) in contestants.items():
            best[name] = min(best[name], 1e6 * cpu_seconds(function) / count)
    return best, compile_seconds, absent, agreement


def difference(found, expected):
    """Largest relative difference between corresponding arrays."""
    pairs = zip(map(np.asarray, found), map(np.asarray, expected), strict=True)
    return float(max(np.abs(a - b).max() / np.abs(b).max() for a, b in pairs))


def in_chunks(size):
    """Processor time and peak memory of filtering a long log in chunks, never wholly in memory."""
    source = jax.tree.map(np.asarray, make_log(CHUNK))
    length = min(CHUNK, size)
    state = pipeline.init(PARAMS, jax.tree.map(jnp.asarray, source))

    @jax.jit
    def step(state, samples):
        state, track = stages.run(PARAMS, state, samples, OPTIONS)
        return state, (track.joint.log_likelihood.sum() + track.wrench.log_likelihood.sum(), track.wrench.mean)

    part = jax.tree.map(lambda x: x[:length], source)
    jax.block_until_ready(step(state, part))
    seconds = np.inf
    for _ in range(1 if size > 1e6 else 3):
        start = time.process_time()
        after, nats = state, 0.0
        for _ in range(-(-size // length)):
            after, (gain, mean) = step(after, part)
            nats += float(gain)
            np.asarray(mean)
        seconds = min(seconds, time.process_time() - start)
    count = length * -(-size // length)
    status = Path("/proc/self/status").read_text()  # getrusage includes the parent
    peak = int(status.split("VmHWM:")[1].split()[0]) / 2**20
    return {"us_per_sample": 1e6 * seconds / count, "peak_GiB": peak, "finite": bool(np.isfinite(nats))}


def main():
    best, compile_seconds, absent, agreement = compare()
    scaling = {}
    for size in SIZES:
        done = subprocess.run([sys.executable, __file__, str(size)], capture_output=True, text=True, check=True)
        scaling[size] = json.loads(done.stdout.splitlines()[-1])
        print(size, scaling[size])
    ratios = {
        "dynamax bias filter / one log, whole pipeline": best.get("dynamax", np.nan) / best["pipeline, float64"],
        "statsmodels bias filter / one log, whole pipeline": best.get("statsmodels", np.nan)
        / best["pipeline, float64"],
        "the same with its shortcut to the steady state": best.get("statsmodels, steady state", np.nan)
        / best["pipeline, float64"],
        "one log / scalar loop": best["pipeline, float64"] / best["loop"],
        "64 logs / scalar loop": best["64 logs, float64"] / best["loop, 64 logs"],
        "gradient / likelihood, one log": best["gradient, float64"] / best["likelihood, float64"],
        "gradient / likelihood, 64 logs": best["64 logs gradient, float64"] / best["64 logs likelihood, float64"],
        "bias gradient / bias filter": best["bias gradient, float64"] / best["bias filter, float64"],
        "1e7 / 1e4 samples, per sample": scaling[10**7]["us_per_sample"] / scaling[10**4]["us_per_sample"],
    }
    result = {
        "us_per_sample_on_one_core": best,
        "ratios": ratios,
        "first_call_or_compile_seconds": compile_seconds,
        "difference_of_results": agreement,
        "absent": absent,
        "in_chunks": scaling,
    }
    result = jax.tree.map(lambda x: float(f"{x:.3g}") if isinstance(x, float) else x, result)
    print(json.dumps(result, indent=1))
    common.keep(__file__, result)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(in_chunks(int(sys.argv[1]))))
    else:
        main()
