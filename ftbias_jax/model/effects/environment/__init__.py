"""Effects of the environment stage: forces on the tool besides gravity, and a tool that is not rigid.

A force F that the environment exerts on the tool lowers the reading by F: the sensor has less to hold.
"""

from ftbias_jax.model.effects.environment.flexibility import FLEXIBILITY as FLEXIBILITY
from ftbias_jax.model.effects.environment.pushes import EFFECTS as EFFECTS
