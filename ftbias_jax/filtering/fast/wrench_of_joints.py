"""What the tool makes the sensor read, from the states of the joints as the filters leave them."""

from functools import partial

import jax
import jax.numpy as jnp
from jax import Array

from ftbias_jax.filtering.fast.scan import Smoothed, States, Track
from ftbias_jax.filtering.step import predict_wrench
from ftbias_jax.model.kinematics.recorded_pose import FreeBody
from ftbias_jax.model.params import Params
from ftbias_jax.model.wrench.batch import wrenches
from ftbias_jax.model.wrench.tool_wrench import Model, covariance_of_joints, joint_sensitivity


def wrenches_of_joints(params: Params, joints: Track | Smoothed | States, known_exactly: bool) -> tuple[Array, Array]:
    """D theta (T, 6) N, Nm, sensor frame, and what the joints' uncertainty adds to its variance (T, 6).

    Args:
        params: of the pipeline.
        joints: their states at every sample.
        known_exactly: whether to leave out their uncertainty.
    """
    if isinstance(params.arm, FreeBody):
        track = joints.stacked() if isinstance(joints, States) else joints
        mean, covariance = jnp.swapaxes(track.mean, 1, 2), jnp.moveaxis(track.covariance, -1, 1)
        return jax.vmap(partial(_of_free_body, params, known_exactly))(mean, covariance)
    entries = _entries(joints)
    return wrenches(Model(params.arm, params.gravity, params.theta), *entries[: 3 if known_exactly else 6])


def _entries(joints: Track | Smoothed | States) -> list[Array]:
    """q, dq and ddq, and P_qq, P_qa and P_aa: what the wrench depends on, (T, n) each."""
    if isinstance(joints, States):
        return [*joints.mean, *(joints.triangle[i] for i in (0, 2, 5))]
    mean, covariance = joints.mean, joints.covariance
    return [*(mean[:, a] for a in range(3)), covariance[:, 0, 0], covariance[:, 0, 2], covariance[:, 2, 2]]


def _of_free_body(params: Params, known_exactly: bool, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Wrench of the tool (6,) and the variance that the pose adds (6,), for one sample of a recorded pose."""
    motion, wrench_tool = predict_wrench(params, mean)
    if known_exactly:
        return wrench_tool, jnp.zeros_like(wrench_tool)
    G = joint_sensitivity(params.theta, motion.R_base_sensor, motion.jacobian, params.gravity)
    return wrench_tool, jnp.diagonal(covariance_of_joints(G, covariance))
