"""What every command takes; light, so that ``--help`` answers at once."""

from ftbias_jax.cli.parsers.logs import OF_LOGS
from ftbias_jax.cli.parsers.setups import OF_SETUPS
from ftbias_jax.cli.parsers.simulators import OF_SIMULATORS

ORDER = (
    "setup filter tune identify calibrate export check simulate diagnose plan replay validate-sim sample effects "
    "info report compare demo"
)
"""Of ``ftbias --help``."""
COMMANDS = {name: (OF_SETUPS | OF_LOGS | OF_SIMULATORS)[name] for name in ORDER.split()}
