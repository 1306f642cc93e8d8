"""No call that is compiled as a whole has unread arguments: XLA may end the process at such a call."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_filters import parts, with_part

from ftbias_jax.filtering import likelihood, pipeline
from ftbias_jax.filtering.method.filter_samples import AS_STATED, METHOD, filter_samples
from ftbias_jax.filtering.noise.blocks import Layout
from ftbias_jax.filtering.pipeline import Options

EFFECTS = {
    "bias_jump": {"time": 0.1, "amplitude": np.ones(6)},
    "cable": {"stiffness": 10.0, "rest_length": 0.1, "anchor": np.array([0.0, 0, 1])},
    "hysteresis": {"amplitude": 0.1 * np.ones(6), "threshold": np.ones(6)},
}


def jaxprs_in(jaxpr):
    for eqn in jaxpr.eqns:
        for value in jax.tree.leaves(list(eqn.params.values()), is_leaf=lambda x: hasattr(x, "jaxpr")):
            inner = getattr(value, "jaxpr", value)
            if hasattr(inner, "eqns"):
                yield eqn, inner
                if eqn.params.get("name") != "whole":  # calls within it are part of it
                    yield from jaxprs_in(inner)


def unread(program, *arguments):
    """Shapes of the arguments of marked calls that these do not read."""
    found, seen = [], 0
    for eqn, inner in jaxprs_in(jax.make_jaxpr(program)(*arguments).jaxpr):
        if eqn.params.get("name") == "whole":
            read = {id(x) for e in inner.eqns for x in e.invars} | {id(x) for x in inner.outvars}
            found += [(str(x.aval), len(inner.invars)) for x in inner.invars if id(x) not in read]
            seen += 1
    assert seen
    return found


@pytest.mark.parametrize("gate", [None, 4.0])
@parts
def test_of_filter_likelihood_and_gradient(params, samples, part, gate):
    params, options = with_part(params, part), Options(gate=gate)
    state = pipeline.init(params, samples)

    def whole(params, samples):
        return pipeline.run(params, state, samples, options, pipeline.keep_all)

    def nats(params, samples):
        return likelihood.log_likelihood(params, samples, options)

    for program in (whole, nats, jax.grad(nats)):
        assert not unread(program, params, samples)
    for method in (METHOD, (*AS_STATED, "smooth_bias")):
        filtered = partial(filter_samples, options=options, method=method, layout=Layout(10, 0.05))
        assert not unread(filtered, params, samples)


def test_of_many_logs(params, samples):
    many = jax.tree.map(lambda x: jnp.stack([x] * 8), samples)

    def nats(params, many):
        return jax.vmap(lambda log: likelihood.log_likelihood(params, log, Options()))(many).sum()

    for program in (nats, jax.grad(nats), jax.grad(nats, 1)):
        assert not unread(program, params, many._replace(rezeroed=None))


@pytest.mark.parametrize("name", EFFECTS)
def test_of_effects(params, samples, name):
    params = params._replace(effects={name: jax.tree.map(jnp.asarray, EFFECTS[name])})

    def whole(params, samples):
        return pipeline.run(params, pipeline.init(params, samples), samples, emit=pipeline.keep_all)

    assert not unread(whole, params, samples)
