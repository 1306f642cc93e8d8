"""State and info of every sample from the fast route: shapes, gaps, restarts, known effects, and unsupported cases."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ftbias_jax.filtering import pipeline


def both_ways(params, samples):
    state = pipeline.init(params, samples)
    return (run(params, state, samples, emit=pipeline.keep_all) for run in (pipeline.run, pipeline.scan_steps))


def test_gaps_restarts_and_missing_axes_are_those_of_single_steps(params, samples):
    """After 1000 s without data every joint restarts; NaN is in the same places."""
    nothing = samples.q.at[10:14].set(jnp.nan)
    broken = samples._replace(
        dt=samples.dt.at[20].set(1e3).at[30].set(0.0),
        q=nothing.at[15, 0].set(jnp.nan),
        dq=samples.dq.at[10:14].set(jnp.nan).at[:, 1].set(jnp.nan),
        wrench=samples.wrench.at[12:18].set(jnp.nan).at[25, 3].set(jnp.nan),
    )
    got, expected = both_ways(params, broken)
    assert not got[1][1].joint.covariance[20, :, 0, 1].any(), "a joint that starts again shares nothing"
    for (path, x), y in zip(jax.tree.leaves_with_path(got), jax.tree.leaves(expected), strict=True):
        # Each sample is scaled by its own size: uncertainty is a billion times larger after the gap.
        rows = np.abs(np.nan_to_num(y)).reshape(y.shape[0], -1).max(1) if y.ndim else 0.0
        scale = 1e-9 * np.reshape(rows, (-1, *[1] * (y.ndim - 1))) + 1e-13
        np.testing.assert_array_equal(np.isnan(x), np.isnan(y), err_msg=jax.tree_util.keystr(path))
        assert (np.nan_to_num(np.abs(x - y)) <= scale).all(), jax.tree_util.keystr(path)


@pytest.mark.parametrize("dtype", [jnp.float32, jnp.float64])
@pytest.mark.parametrize("length", [0, 1, 40, 2000])
def test_shapes_and_dtypes_are_those_of_single_steps(params, samples, dtype, length):
    numbers, log = jax.tree.map(lambda x: x.astype(dtype), (params, samples))
    log = jax.tree.map(lambda x: jnp.resize(x, (length, *x.shape[1:])), log)
    state = pipeline.init(numbers, jax.tree.map(lambda x: x.astype(dtype), samples))
    got, expected = (jax.eval_shape(run, numbers, state, log) for run in (pipeline.run, pipeline.scan_steps))
    assert got == expected


def test_a_known_jump_of_the_bias_is_no_innovation(params, samples):
    """States and innovations equal those of a reading from which the jump was subtracted."""
    jump = jnp.array([1.0, -2.0, 3.0, 0.1, 0.2, -0.3])
    here = jnp.cumsum(samples.dt)[17]
    knowing = params._replace(effects={"bias_jump": {"time": here, "amplitude": jump}})
    jumped = samples._replace(wrench=samples.wrench.at[17:].add(-jump))
    (states, infos), (expected, expected_infos) = (
        pipeline.run(numbers, pipeline.init(params, log), log, emit=pipeline.keep_all)[1]
        for numbers, log in ((knowing, jumped), (params, samples))
    )
    np.testing.assert_allclose(states.bias.mean, expected.bias.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(infos.wrench.value, expected_infos.wrench.value, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(infos.log_likelihood, expected_infos.log_likelihood, rtol=1e-9)
    moved = infos.wrench_tool - expected_infos.wrench_tool
    np.testing.assert_allclose(moved, np.where(np.arange(40)[:, None] < 17, 0, -jump), atol=1e-10)


def test_gradients_take_the_reverse_pass_written_by_hand_and_forward_mode_the_scan_of_steps(params, samples):
    state = pipeline.init(params, samples)

    def along(run):
        def nats(theta):
            return run(params._replace(theta=theta), state, samples, emit=pipeline.keep_all)[1][1].log_likelihood.sum()

        return jax.jit(lambda x: jax.jvp(nats, (x,), (x,))[1]).lower(params.theta)

    with pytest.raises(TypeError, match="custom_vjp"):
        along(pipeline.run)
    assert along(pipeline.scan_steps).out_info.shape == ()
