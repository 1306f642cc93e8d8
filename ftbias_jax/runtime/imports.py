"""Faster import of many modules, for commands that start."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LARGEST = "jax"
"""The package with the most modules; if it is already imported, little is left to import."""


@contextmanager
def many_imports() -> Iterator[None]:
    """Suspend garbage collection while the block imports modules, and exempt the objects made there from later ones.

    Modules create hundreds of thousands of objects that stay, and every collection would scan all of them, which takes
    a seventh of the import time. A process that has already imported them is left as it is.
    """
    if LARGEST in sys.modules or not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
