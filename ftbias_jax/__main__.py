"""``python -m ftbias_jax`` is the command ``ftbias``."""

import sys

from ftbias_jax.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
