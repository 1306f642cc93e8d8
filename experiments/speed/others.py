"""The bias filter in other libraries: 12 states, 6 measurements, constant matrices; y (T, 6) -> (mean, log-likelihood).

Each maker takes (A, Q, C, R, mean, covariance) and returns a function of y that gives the last filtered mean (12,) and
the log-likelihood. A library that is not installed raises its ImportError.
"""

import numpy as np


def statsmodels(A, Q, C, R, mean, covariance, tolerance=0.0):
    """The shortcut to the steady state is off, because a log's dt is not constant and samples are missing."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    def run(y):
        model = KalmanFilter(6, 12, design=C, obs_cov=R, transition=A, selection=np.eye(12), state_cov=Q)
        model.bind(np.ascontiguousarray(y))
        model.initialize_known(mean, covariance)
        model.tolerance = tolerance
        result = model.filter()
        return result.filtered_state[:, -1], result.llf

    return run


def statsmodels_shortcut(*matrices):
    """With the default shortcut to the steady state, which needs a constant dt without gaps."""
    return statsmodels(*matrices, tolerance=1e-19)


def _dynamax(A, C, mean, covariance):
    """Return a function (Q, R, y) -> posterior of dynamax's filter."""
    from functools import partial

    import jax
    import jax.numpy as jnp
    from dynamax.linear_gaussian_ssm import LinearGaussianSSM, inference, lgssm_filter
    from dynamax.utils.utils import psd_solve

    # dynamax adds 1e-9 to the innovation covariance, 6e-5 of that of the torque, which would change the model.
    inference.psd_solve = partial(psd_solve, diagonal_boost=0.0)
    names = ("initial_mean", "initial_covariance", "dynamics_weights", "emission_weights")
    constants = dict(zip(names, map(jnp.asarray, (mean, covariance, A, C)), strict=True))

    def run(Q, R, y):
        noise = {"dynamics_covariance": Q, "emission_covariance": R}
        params, _ = LinearGaussianSSM(12, 6).initialize(jax.random.key(0), **constants, **noise)
        return lgssm_filter(params, y)

    return run


def dynamax(A, Q, C, R, mean, covariance):
    import jax
    import jax.numpy as jnp

    run, Q, R = _dynamax(A, C, mean, covariance), jnp.asarray(Q), jnp.asarray(R)

    @jax.jit
    def last(y):
        result = run(Q, R, y)
        return result.filtered_means[-1], result.marginal_loglik

    return last


def dynamax_gradient(A, Q, C, R, mean, covariance):
    import jax
    import jax.numpy as jnp

    run, Q, R = _dynamax(A, C, mean, covariance), jnp.asarray(Q), jnp.asarray(R)
    slopes = jax.value_and_grad(lambda Q, R, y: run(Q, R, y).marginal_loglik, (0, 1))
    return jax.jit(lambda y: slopes(Q, R, y))


def cuthbert(A, Q, C, R, mean, covariance):
    import jax
    import jax.numpy as jnp
    from cuthbertlib.kalman import filtering

    roots = {name: jnp.linalg.cholesky(x) for name, x in (("P", covariance), ("Q", Q), ("R", R))}
    A, C, mean = map(jnp.asarray, (A, C, mean))
    nothing = jnp.zeros(12), jnp.zeros(6)

    @jax.jit
    def run(y):
        def correct(m, P, y):
            (m, P), nats = filtering.update(m, P, C, nothing[1], roots["R"], y)[:2]
            return (m, P), nats

        def body(carry, y):
            m, P, total = carry
            m, P = filtering.predict(m, P, A, nothing[0], roots["Q"])
            (m, P), nats = correct(m, P, y)
            return (m, P, total + nats), None

        (m, P), nats = correct(mean, roots["P"], y[0])
        (m, _, total), _ = jax.lax.scan(body, (m, P, nats), y[1:])
        return m, total

    return run


def filterpy(A, Q, C, R, mean, covariance):
    from filterpy.kalman import KalmanFilter

    def run(y):
        model = KalmanFilter(12, 6)
        model.F, model.Q, model.H, model.R = A, Q, C, R
        model.x, model.P = mean.reshape(-1, 1).copy(), covariance.copy()
        total = 0.0
        for i, z in enumerate(y):
            if i:
                model.predict()
            model.update(z.reshape(-1, 1))
            total += model.log_likelihood
        return model.x[:, 0], total

    return run


def simdkalman(A, Q, C, R, mean, covariance):
    import simdkalman as library

    def run(y):
        model = library.KalmanFilter(A, Q, C, R)
        result = model.compute(
            y[None],
            0,
            initial_value=mean,
            initial_covariance=covariance,
            filtered=True,
            smoothed=False,
            log_likelihood=True,
        )
        # The library omits the constant of the Gaussian density.
        return result.filtered.states.mean[0, -1], result.log_likelihood[0] - y.size / 2 * np.log(2 * np.pi)

    return run


def pykalman(A, Q, C, R, mean, covariance):
    import pykalman as library

    def run(y):
        model = library.KalmanFilter(A, C, Q, R, initial_state_mean=mean, initial_state_covariance=covariance)
        return model.filter(y)[0][-1], model.loglikelihood(y)

    return run


LIBRARIES = {
    "statsmodels": statsmodels,
    "dynamax": dynamax,
    "cuthbert": cuthbert,
    "filterpy": filterpy,
    "simdkalman": simdkalman,
    "pykalman": pykalman,
}
OTHER_RESULTS = {"dynamax gradient": dynamax_gradient, "statsmodels, steady state": statsmodels_shortcut}
"""Timed as well, but with results that differ from the filter's, and so are not compared."""
SLOW = ("filterpy", "simdkalman", "pykalman")
