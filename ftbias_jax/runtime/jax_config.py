"""JAX configuration for commands and API functions: double precision and a persistent cache of compiled programs."""

import os
import stat
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from contextvars import copy_context
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import jax
import jax.numpy as jnp

from ftbias_jax.errors import UsageError
from ftbias_jax.runtime.compiled_loops import on_cpu

P = ParamSpec("P")
R = TypeVar("R")

MIN_COMPILE_SECONDS = 0.02
"""s; programs that compile faster are not worth a file in the cache."""
LARGEST_PROGRAM = 1 << 28
"""Maximum bytes of a file in the cache; a larger one is not from this package, and the cache is not read then."""
CACHE_SWITCH = "FTBIAS_CACHE"
"""Name of an environment variable; "off" = compiled programs are not kept."""


def prepare_jax() -> None:
    """Configure a dedicated process for float64 and kept programs; to be called before any array is created.

    The CPU is used unless the environment names a device, because a single log takes longer on another one.

    Raises:
        UsageError: JAX has no device of the kind that the environment asks for.
    """
    jax.config.update("jax_enable_x64", True)
    if not os.environ.get("JAX_PLATFORMS"):
        jax.config.update("jax_platforms", "cpu")
    try:
        jax.devices()
    except (RuntimeError, AssertionError) as error:
        asked = os.environ.get("JAX_PLATFORMS", "")
        message = f"JAX cannot start on {asked!r}: {str(error) or 'there is no such device'}"
        raise UsageError(message, field="JAX_PLATFORMS", remedy="unset it, or install JAX for that device") from error
    keep_programs()


def keep_programs() -> None:
    """Keep compiled programs in the user's cache folder, so that the next process need not compile them.

    JAX's own cache settings (``JAX_COMPILATION_CACHE_DIR``, ``JAX_ENABLE_COMPILATION_CACHE``) take precedence, and
    ``FTBIAS_CACHE=off`` keeps nothing. If the folder cannot be created, programs are compiled anew in every process.
    """
    config: Any = jax.config  # JAX's type hints lack its settings
    decided = config.jax_compilation_cache_dir is not None or not config.jax_enable_compilation_cache
    if decided or os.environ.get(CACHE_SWITCH, "").lower() == "off":
        return
    folder = cache_folder() / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK) and _is_readable(folder):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", MIN_COMPILE_SECONDS)


def _is_readable(folder: Path) -> bool:
    """Whether a cache holds only folders and plain files; JAX does not check that, and would wait forever on a pipe."""
    try:
        with os.scandir(folder) as entries:
            return all(entry.is_dir(follow_symlinks=False) or is_plain(entry.stat()) for entry in entries)
    except OSError:
        return False


def is_plain(state: os.stat_result) -> bool:
    """Whether a file is a regular one, of a size that a compiled program may have."""
    return stat.S_ISREG(state.st_mode) and state.st_size <= LARGEST_PROGRAM


def in_float64(verb: Callable[P, R]) -> Callable[P, R]:
    """Decorator that computes in float64, whatever JAX's setting is, and keeps the compiled programs.

    The CPU is used unless the caller has chosen a device (``JAX_PLATFORMS``, ``jax.default_device``). The settings
    apply while the function runs, in the calling thread; the caller's own programs are unaffected.
    """

    @wraps(verb)
    def run(*arguments: P.args, **named: P.kwargs) -> R:
        keep_programs()
        with _precision(wide=True), nullcontext() if _is_chosen() else on_device(None):
            return verb(*arguments, **named)

    return run


def same_precision(function: Callable[P, R]) -> Callable[P, R]:
    """Wrap a function for other threads, so that it runs with the precision, device and context of this thread."""
    config: Any = jax.config  # JAX's type hints lack its settings
    wide, device, context = is_float64(), config.jax_default_device, copy_context()

    @wraps(function)
    def run(*arguments: P.args, **named: P.kwargs) -> R:
        with _precision(wide), on_device(device) if device else nullcontext():
            return context.copy().run(function, *arguments, **named)

    return run


def _precision(wide: bool) -> AbstractContextManager[object]:
    # An unchanged setting is not set again, because JAX would retrace its programs.
    return nullcontext() if wide == is_float64() else jax.enable_x64(wide)


def _is_chosen() -> bool:
    """Whether the caller has chosen the device on which JAX computes."""
    config: Any = jax.config  # JAX's type hints lack its settings
    return bool(config.jax_platforms or config.jax_default_device)


def on_device(device: Any) -> AbstractContextManager[object]:
    """Context in which JAX computes on a device; None = on the CPU, if JAX may use it."""
    if device is None:
        if on_cpu():  # an unchanged setting is not set again, because JAX would retrace its programs
            return nullcontext()
        try:
            device = jax.devices("cpu")[0]
        except RuntimeError:
            return nullcontext()
    return jax.default_device(device)


def accelerator() -> Any:
    """The device on which JAX computes; None if it is the CPU."""
    config: Any = jax.config  # JAX's type hints lack its settings
    return None if on_cpu() else config.jax_default_device or jax.devices()[0]


def is_float64() -> bool:
    """Whether arrays created in this thread now have double precision."""
    return bool(jnp.result_type(float) == jnp.float64)


def cache_folder() -> Path:
    """Folder of this user's ftbias caches, in ``$XDG_CACHE_HOME`` or in ``~/.cache``."""
    stated = Path(os.environ.get("XDG_CACHE_HOME", ""))
    home = Path(os.path.expanduser("~"))  # unlike Path.home() this cannot fail
    return (stated if stated.is_absolute() else home / ".cache") / "ftbias"
