"""Joints and bias given the whole log, past and future: Rauch-Tung-Striebel over tracks of the filters."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from ftbias_jax.filtering.fast.rts import smooth_track
from ftbias_jax.filtering.fast.scan import Inputs, Smoothed, filter_scan
from ftbias_jax.filtering.fast.stages import add_noise, joint_inputs, joint_states
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options, State
from ftbias_jax.filtering.process_models import JOINT_MODELS, bias_model
from ftbias_jax.model.params import Params
from ftbias_jax.types import Gaussian, Sample


@jax.jit
def smooth_axes(inputs: Inputs) -> tuple[Float[Array, "T 2 6"], Float[Array, "T 2 6"]]:
    """Smoothed bias and drift, from ``stages.bias_inputs``: means and standard deviations (T, 2, 6)."""
    model = bias_model(inputs.density)
    smoothed = smooth_track(model, inputs, filter_scan(model, inputs))
    mean, covariance = add_noise(smoothed.mean, smoothed.covariance, -1)
    return mean[:, :2], jnp.sqrt(jnp.swapaxes(jnp.diagonal(covariance, axis1=1, axis2=2), 1, 2))[:, :2]


@partial(jax.jit, static_argnames="options")
def smooth_joints(params: Params, state: State, samples: Sample, options: Options = DEFAULT_OPTIONS) -> Gaussian:
    """Joint states given the whole log: mean (T, n, 3) and covariance (T, n, 3, 3)."""
    return joint_states(smooth_joint_tracks(params, state, samples, options))


def smooth_joint_tracks(params: Params, state: State, samples: Sample, options: Options) -> Smoothed:
    """The same with the axes of a track."""
    model, inputs = JOINT_MODELS[options.joint_model], joint_inputs(params, state, samples)
    return smooth_track(model, inputs, filter_scan(model, inputs))
