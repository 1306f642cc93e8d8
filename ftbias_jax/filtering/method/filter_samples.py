"""The method over a whole log (docs/pages/model.md) as one pure function.

``METHOD`` names its passes in their order; each takes what is known of the log and adds to it. ``AS_STATED`` is the
filter as it would run on a robot: joints from the past alone, noise as the setup states it.
"""

from collections.abc import Callable
from functools import partial

import jax
import numpy as np

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering import pipeline
from ftbias_jax.filtering.likelihood import measured_length
from ftbias_jax.filtering.method import joints, passes
from ftbias_jax.filtering.method.work import Infos, Joints, States, Work
from ftbias_jax.filtering.noise.blocks import LEAST_BLOCKS, Layout, layout_of
from ftbias_jax.filtering.pipeline import DEFAULT_OPTIONS, Options
from ftbias_jax.model.params import JointNoise, Params
from ftbias_jax.runtime.compiled_loops import log_by_log_with_slopes, running_sum
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Sample

OF_JOINTS = (joints.fit_joint_noise, joints.guard_joints, joints.smooth_joints, joints.filter_joints)
OF_BIAS = (passes.fit_noise, passes.filter_bias, passes.begin_at_median, passes.smooth_bias)
PASSES: dict[str, Callable[[Work], Work]] = {function.__name__: function for function in (*OF_JOINTS, *OF_BIAS)}
METHOD = ("smooth_joints", "fit_noise", "filter_bias")
"""The passes over a recorded log, before ``summarise``."""
AS_STATED = ("filter_joints", "filter_bias")
"""The passes of a filter on the robot."""


def filter_samples(
    params: Params,
    samples: Sample,
    options: Options = DEFAULT_OPTIONS,
    *,
    method: tuple[str, ...] = METHOD,
    layout: Layout | None = None,
) -> tuple[Params, States, Infos]:
    """Filter a log, as ``filter_log`` does: a pure function, to be compiled, mapped over logs and differentiated.

    Outside of ``jax.jit`` it runs as two programs: the second one, of noise and bias, does not depend on effects, so
    that it need not be compiled for each of these.

    Args:
        params: from ``params_for_log(guarded=False)``; differentiable with respect to every leaf (``jax.grad``, not
            ``jax.jvp``). Noise estimated from the log counts as constant.
        samples: from ``samples_from_log``, leaves (T, ...); padding does not count.
        options: of the pipeline, from ``options_from_setup`` where a setup states any.
        method: keys of PASSES in their order.
        layout: of the blocks in which the noise is found, from ``layout_of``; None = that of these samples.

    Returns:
        the parameters with the noise of the log, with which its bias was filtered, the states and the infos.

    Raises:
        UsageError: the samples are traced by a program, and the layout is not given.
    """
    if layout is None:
        if isinstance(samples.dt, jax.core.Tracer):
            message = "is not given, and inside jax.jit, jax.vmap or jax.grad it cannot be read off the samples"
            raise UsageError(message, field="layout", remedy="give layout_of(dt) of one log")
        layout = layout_of(np.asarray(samples.dt))
    method, fixed = method_for(samples, method, layout), {"options": options, "layout": layout}
    of_joints = tuple(name for name in method if PASSES[name] in OF_JOINTS)
    joint, known = _know_joints(params, samples, method=of_joints, **fixed)
    rest, what_follows = params._replace(joint=joint, effects=None), samples._replace(temperature=None, columns=None)
    found, states, infos = _know_bias(rest, what_follows, known, method=method[len(of_joints) :], **fixed)
    return found._replace(effects=params.effects), states, infos


@partial(jax.jit, static_argnames=("options", "method", "layout"))
def filter_each(
    params: Params, samples: Sample, *, options: Options, method: tuple[str, ...], layout: Layout
) -> tuple[Params, States, Infos]:
    """``filter_samples`` of many logs as one program, where all leaves have one more leading axis."""
    return jax.vmap(partial(filter_samples, options=options, method=method, layout=layout))(params, samples)


def method_for(samples: Sample, method: tuple[str, ...], layout: Layout) -> tuple[str, ...]:
    """The passes over a log, without ``fit_noise`` if it is too short to show its noise."""
    traced = isinstance(samples.dt, jax.core.Tracer)
    length = len(samples.dt) if traced else int(measured_length(samples, np))
    return tuple(name for name in method if name != "fit_noise" or length // layout.size >= LEAST_BLOCKS)


@keep_program("options", "method", "layout")
def _know_joints(
    params: Params, samples: Sample, *, options: Options, method: tuple[str, ...], layout: Layout
) -> tuple[JointNoise, Joints]:
    """The joints, and the joint noise with which they were filtered."""

    def one(params: Params, samples: Sample) -> tuple[JointNoise, Joints]:
        work = _passed(_begun(params, samples, layout, options), method)
        return work.params.joint, work.joints

    return log_by_log_with_slopes(one)(params, samples)


@keep_program("options", "method", "layout")
def _know_bias(
    params: Params, samples: Sample, known: Joints, *, options: Options, method: tuple[str, ...], layout: Layout
) -> tuple[Params, States, Infos]:
    def one(params: Params, samples: Sample, known: Joints) -> tuple[Params, States, Infos]:
        work = _begun(params, samples, layout, options)
        return passes.summarise(_passed(work._replace(joints=known, end=work.start), method))

    return log_by_log_with_slopes(one)(params, samples, known)


def _begun(params: Params, samples: Sample, layout: Layout, options: Options) -> Work:
    start = pipeline.init(params, samples)._replace(bias=None)
    return Work(params, start, samples, running_sum(samples.dt), measured_length(samples), layout, options)


def _passed(work: Work, method: tuple[str, ...]) -> Work:
    for name in method:
        work = PASSES[name](work)
    return work
