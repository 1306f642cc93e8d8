"""Bias and drift of a wrist force-torque sensor from a recorded log.

Nothing heavy is imported here and no global flag of JAX is touched. The pieces:

- ``ftbias_jax.setup.load_setup`` and ``ftbias_jax.io.read_log`` read what the robot's owner has;
- ``ftbias_jax.filtering.pipeline``: ``init``, ``step`` and ``run``, pure, jitted, differentiable;
- ``ftbias_jax.filtering.filter_log.filter_log``: a whole recorded log, numpy in and out.
"""

__version__ = "0.1.0"
