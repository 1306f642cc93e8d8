"""A log whose joints are smoothed in pieces, and padded, against the smoother of the whole log."""

import tomllib

import jax
import numpy as np
import pytest
import small_archive

import ftbias_jax as ft
from ftbias_jax.filtering import filter_log, pipeline, smoother
from ftbias_jax.filtering.likelihood import joint_log_likelihood
from ftbias_jax.filtering.recorded.prepare import prepare
from ftbias_jax.filtering.samples import arrays_from_log, first_position

SECONDS = 12.0
"""At 50 Hz 600 samples: two pieces and a part of a third, and a fourth that is padding."""


@pytest.fixture(scope="module")
def log():
    setup = ft.parse_setup(tomllib.loads(small_archive.SETUP), "setup.toml")
    log = ft.simulate(setup, duration=SECONDS, rate=50, seed=0).log
    q = log.q.copy()
    q[250:262] = np.nan  # a gap across the end of a piece
    return setup, log._replace(q=q)


def test_pieces_say_what_the_smoother_of_the_whole_log_says(log):
    setup, log = log
    with jax.enable_x64(True):
        samples = arrays_from_log(log)._replace(temperature=None)
        params, options = filter_log.likeliest_params(setup, samples), pipeline.options_from_setup(setup)
        (part,) = prepare(params, first_position(log.q), [log], options)
        whole = smoother.smooth_joints(params, pipeline.init(params, samples), samples, options)
        nats = joint_log_likelihood(params, samples, options)
    np.testing.assert_allclose(np.swapaxes(part.joints.mean, 1, 2), whole.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.moveaxis(part.joints.covariance, -1, 1), whole.covariance, rtol=1e-7, atol=1e-14)
    assert part.joint_log_likelihood == pytest.approx(float(nats), rel=1e-12)
    assert len(part.wrench_tool) == len(part.variance) == len(log.t)
