"""Log-likelihood of a log in chunks of time, keeping only two sums and the state after each chunk.

The reverse pass starts from those states: it recomputes every chunk, with all that its derivatives need, while the
chunk is in the processor's cache. So its memory is that of one chunk, whatever the length of the log.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Float

from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import Smoothed, filter_sums
from ftbias_jax.filtering.process_models import JOINT_MODELS
from ftbias_jax.filtering.samples import pad
from ftbias_jax.filtering.step import Options, State
from ftbias_jax.model.params import Params
from ftbias_jax.runtime.compiled_loops import log_by_log_with_slopes
from ftbias_jax.types import Sample

CHUNK = 512
"""Samples that pass through all stages together and are recomputed together."""
WRENCH = "wrench of the tool"
"""Name of the value that the reverse pass does not recompute, because it costs as much as the filters."""

Nats = tuple[Array, Array]
"""Log-likelihoods of the joints () and of the wrench (), nats."""


@partial(jax.jit, static_argnames="options")
def log_likelihoods(
    params: Params, state: State, samples: Sample, weight: Float[Array, " T"], options: Options
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Weighted sums of the log-likelihood increments of joints and of wrench, with a weight for every sample."""
    return log_by_log_with_slopes(partial(_of_log, options))(params, state, samples, weight)


def _of_log(options: Options, params: Params, state: State, samples: Sample, weight: Array) -> Nats:
    length = samples.dt.shape[0]
    count = 1 if params.effects is not None else -(-length // CHUNK)
    size = -(-length // count)
    padded = pad(samples, count * size), jnp.pad(weight, (0, count * size - length))
    chunks = jax.tree.map(lambda x: x.reshape(count, size, *x.shape[1:]), padded)

    def pass_over(state: State, chunk: tuple[Sample, Array]) -> tuple[State, Nats]:
        zero = jnp.zeros_like(chunk[1][0])
        return state, (zero, zero)

    @partial(jax.checkpoint, policy=jax.checkpoint_policies.save_only_these_names(WRENCH), prevent_cse=False)
    def of_chunk(state: State, chunk: tuple[Sample, Array]) -> tuple[State, Nats]:
        work = partial(_of_chunk, options, params)
        return jax.lax.cond(is_there(chunk[0]), work, pass_over, state, chunk)

    nats: Nats = jax.lax.scan(of_chunk, state, chunks)[1]
    return nats[0].sum(), nats[1].sum()


def is_there(samples: Sample) -> Array:
    """Whether time passes or anything is measured: a chunk for which neither is true is padding."""
    measured = [jnp.isfinite(x).any() for x in (samples.q, samples.dq, samples.wrench)]
    return jnp.stack([(samples.dt != 0).any(), *measured]).any()


def _of_chunk(options: Options, params: Params, state: State, chunk: tuple[Sample, Array]) -> tuple[State, Nats]:
    """All stages over a chunk: ``stages.run`` without its output for every sample."""
    samples, weight = chunk
    joint = filter_sums(
        JOINT_MODELS[options.joint_model], True, stages.joint_inputs(params.joint, state.joint, samples), weight
    )
    assert joint.states is not None
    predicted = stages.predict_wrenches(params, joint.states, samples, options)
    wrench_tool, variance = (checkpoint_name(x, WRENCH) for x in predicted)
    inputs = stages.bias_inputs(params, state, samples, wrench_tool, variance, joint.states.mean[1])
    wrench = filter_sums(stages.gated(inputs, options), False, inputs, weight)
    joint_last = stages.joint_states(Smoothed(joint.mean, joint.covariance))
    bias_last = stages.bias_state(Smoothed(*stages.add_noise(wrench.mean, wrench.covariance, -1)))
    return State(joint_last, bias_last), (joint.nats.sum(), wrench.nats.sum())
