"""Many modules imported at once, as a command does that starts."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

LARGEST = "jax"
"""The package that brings most modules: where it is imported already, little is left to do."""


@contextmanager
def many_imports() -> Iterator[None]:
    """While the block imports modules, do not look for garbage, and never again among what it made.

    Modules make hundreds of thousands of objects that stay, and every search would look through all of them: that is
    a seventh of the time that imports take. In a process that has imported them before nothing changes.
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
