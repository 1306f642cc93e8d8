"""JAX as the command line wants it: double precision, and programs that stay compiled between runs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import jax

MIN_COMPILE_SECONDS = 0.02
"""Programs that compile faster are not worth a file."""


def prepare_jax() -> None:
    """Compute in float64 and keep compiled programs in the user's cache folder; call it before any array is made.

    A cache that JAX was already told about (``JAX_COMPILATION_CACHE_DIR``) stays. Where no folder can be made,
    everything works and is compiled anew each time.
    """
    jax.config.update("jax_enable_x64", True)
    config: Any = jax.config  # JAX's types do not know its settings
    if config.jax_compilation_cache_dir is not None:
        return
    folder = cache_folder() / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", MIN_COMPILE_SECONDS)


def cache_folder() -> Path:
    """Where this user's caches of ftbias belong: in ``$XDG_CACHE_HOME``, or in ``~/.cache``."""
    stated = Path(os.environ.get("XDG_CACHE_HOME", ""))
    home = Path(os.path.expanduser("~"))  # unlike Path.home() this cannot fail
    return (stated if stated.is_absolute() else home / ".cache") / "ftbias"
