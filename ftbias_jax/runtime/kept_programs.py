"""Programs that stay compiled between processes, and need not even be traced again.

JAX keeps what XLA compiled, under a name that is known only after the program was traced and lowered. That takes a
second for a long program, in every process. Here the name is made of what a program depends on: the function, shapes
and precision of its arguments, the sources of this package, versions and processor. So a program that was ever compiled
is loaded and called.
"""

import ctypes
import hashlib
import os
import pickle
import platform
import stat
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache, update_wrapper
from importlib.metadata import version
from pathlib import Path
from threading import Lock
from typing import Any

import jax
import numpy as np
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from ftbias_jax.files import replace_whole
from ftbias_jax.runtime.compiled_loops import on_cpu
from ftbias_jax.runtime.jax_config import is_plain, is_wide

FEW_CALLS, MANY_CALLS = 0, 1
"""Level at which LLVM optimises. Programs of level 0 are compiled in less than half of the time, and run four times as
long; those of level 1 run as long as those of higher levels."""
SHORT = 1 << 15
"""Samples for which compiling a fast program takes longer than what it saves in a few calls."""
OLDER_EMITTERS = {"xla_cpu_use_fusion_emitters": False}
"""They make equally fast programs of some hundred small kernels in two thirds of the time."""
LAPACK = b"lapack_"
"""In a program that calls LAPACK, which a process that only reads it has not loaded: the call would end the process."""
_level: ContextVar[int] = ContextVar("_level", default=MANY_CALLS)
ADDRESS = " at 0x"
"""In the words for an object that nothing but its place in memory tells from others: such a program is not kept."""


class KeptProgram:
    """A function of arrays that is compiled once for all processes; inside another program it is a part of that one."""

    def __init__(self, function: Callable[..., Any], static: tuple[str, ...]) -> None:
        update_wrapper(self, function)
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._function = jax.jit(function, static_argnames=static)
        self._ready: dict[Hashable, Future[Callable[..., Any]]] = {}
        self._lock = Lock()

    def __call__(self, *arguments: Any, **static: Any) -> Any:
        """What the function returns."""
        leaves, tree = jax.tree.flatten(arguments)
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return self._function(*arguments, **static)
        return self._program(leaves, tree, static)(*arguments)

    def prepare(self, *arguments: Any, **static: Any) -> Callable[..., Any]:
        """The program for arguments of such shapes, loaded or compiled: it is called without those in ``static``."""
        return self._program(*jax.tree.flatten(arguments), static)

    def _program(self, leaves: list[Any], tree: Any, static: dict[str, Any]) -> Callable[..., Any]:
        shapes = shapes_of(leaves)
        told = tree, shapes, tuple(static.items()), is_wide(), on_cpu()
        fast, asked = ((*told, level) for level in (MANY_CALLS, _level.get()))
        with self._lock:
            key = fast if fast in self._ready else asked
            mine = key not in self._ready
            ready = self._ready.setdefault(key, Future())
        if mine:  # who else wants it waits for this thread
            try:
                ready.set_result(self._make(tree, shapes, static, f"{self._name} {key}"))
            except BaseException as error:
                del self._ready[key]
                ready.set_exception(error)
                raise
        return ready.result()

    def _make(self, tree: Any, shapes: Any, static: dict[str, Any], words: str) -> Callable[..., Any]:
        """The program from the cache, or compiled and put there."""
        path = _path(words)

        def compiled() -> Callable[..., Any]:
            outline = jax.tree.unflatten(tree, [jax.ShapeDtypeStruct(*shape) for shape in shapes])

            def named(*arguments: Any) -> Any:
                return self._function(*arguments, **static)

            # JAX's own cache knows it by this name: of what it has loaded from there no copy can be made.
            named.__name__ = named.__qualname__ = path.stem if path else self._name
            program: Callable[..., Any] = _compile(jax.jit(named).lower(*outline))
            if path is not None:
                _keep(path, program)
            return program

        if path is not None and _is_own(path.parent):
            with suppress(Exception):  # a file of a cache may be anything: then it is made again
                kept: Callable[..., Any] = deserialize_and_load(*pickle.loads(_content(path)))
                _return_memory()
                return _tried(kept, compiled)
        return compiled()


def _compile(lowered: Any) -> Any:
    """A program of what was traced."""
    try:
        chosen = {**OLDER_EMITTERS, "xla_backend_optimization_level": _level.get()} if on_cpu() else None
        return lowered.compile(compiler_options=chosen)
    except jax.errors.JaxRuntimeError:  # a version of XLA that does not know the options
        return lowered.compile()
    finally:
        _return_memory()


def _tried(kept: Callable[..., Any], compiled: Callable[[], Callable[..., Any]]) -> Callable[..., Any]:
    """A program that was read, until it fails: that some of its functions are missing shows when it is called."""
    chosen: list[Callable[..., Any]] = []

    def program(*arguments: Any) -> Any:
        if not chosen:
            try:
                found = jax.block_until_ready(kept(*arguments))
            except jax.errors.JaxRuntimeError:
                chosen.append(compiled())
            else:
                chosen.append(kept)
                return found
        return chosen[0](*arguments)

    return program


@contextmanager
def compiled_for_few_calls(samples: int = 0) -> Iterator[None]:
    """What is compiled in the block, and in threads that it starts, need not be fast: waiting for it takes longer.

    Where it works on SHORT ``samples`` or fewer; more than these take longer than what compiling saves.
    """
    before = _level.set(FEW_CALLS if samples <= SHORT else _level.get())
    try:
        yield
    finally:
        _level.reset(before)


def shapes_of(leaves: list[Any]) -> tuple[tuple[tuple[int, ...], np.dtype], ...]:
    """Shape and precision of arrays or numbers, by which programs differ."""
    return tuple((np.shape(leaf), np.dtype(getattr(leaf, "dtype", type(leaf)))) for leaf in leaves)


def keep_program(*static: str) -> Callable[[Callable[..., Any]], KeptProgram]:
    """Make a function of trees of arrays a program that is kept.

    The arguments of the ``static`` names are part of the program, and given by name.
    """
    return lambda function: KeptProgram(function, static)


def _return_memory() -> None:
    """Give back what compiling or loading a program took and needs no more: some 100 MB, which the C library keeps."""
    with suppress(Exception):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)


def _keep(path: Path, compiled: Any) -> None:
    """Write a program."""
    with suppress(Exception):  # a full disk, or a program that cannot be kept
        content = path.stem.encode() + pickle.dumps(serialize(compiled))
        if LAPACK in content:
            return
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        replace_whole(str(path), lambda file: file.write(content))


def _content(path: Path) -> bytes:
    """The program in a file, which is one, and that of its name.

    Raises:
        OSError, ValueError: it is not.
    """
    with open(os.open(path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
        if not is_plain(os.fstat(file.fileno())):
            raise ValueError("is no file of a sensible size")
        content = file.read()
    name = path.stem.encode()
    if not content.startswith(name):
        raise ValueError("has another program")
    return content[len(name) :]


def _path(words: str) -> Path | None:
    """Where a program is kept, by words for what it depends on beside package, versions, processor; None = nowhere."""
    config: Any = jax.config  # JAX's types do not know its settings
    folder = config.jax_compilation_cache_dir
    if not folder or not config.jax_enable_compilation_cache or ADDRESS in words or not on_cpu():
        return None
    digest = hashlib.sha256(f"{_surroundings()} {words}".encode()).hexdigest()
    return Path(folder) / "ftbias" / f"{digest[:32]}.program"


def _is_own(folder: Path) -> bool:
    """Whether a folder of programs is this user's, and nobody else can write there.

    Loading a program is running it (and its shapes are a pickle): what others may have put there is not read.
    """
    try:
        state = folder.stat()
    except OSError:
        return False
    mine = not hasattr(os, "getuid") or state.st_uid == os.getuid()
    return mine and not state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


@lru_cache
def _surroundings() -> str:
    """Digest of the package's sources, of versions and of the processor."""
    sources = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for path in sorted(sources.rglob("*.py")):
        digest.update(f"{path.relative_to(sources)}\0".encode() + path.read_bytes())
    digest.update(f"{version('jax')} {version('jaxlib')} {os.environ.get('XLA_FLAGS')}".encode())
    digest.update(f"{platform.machine()} {platform.processor()} {_processor()}".encode())
    return digest.hexdigest()


def _processor() -> str:
    """What the processor can do, where the system tells it: compiled code makes use of all of it."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return " ".join(sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))}))
    return ""
