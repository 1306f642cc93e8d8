"""Persistent cache of compiled programs that avoids both compiling and tracing in later processes.

JAX caches what XLA has compiled, but under a key that is known only after the program has been traced and lowered. That
takes a second for a long program, in every process. Here the key is made of what a program depends on: the function,
shapes and precision of its arguments, the sources of this package, versions and processor. A program that was compiled
before is therefore loaded and called directly.
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
from ftbias_jax.runtime.jax_config import is_float64, is_plain

FEW_CALLS, MANY_CALLS = 0, 1
"""LLVM optimisation levels. Programs of level 0 compile in less than half the time but take four times as long to run;
those of level 1 run as fast as those of higher levels."""
SHORT = 1 << 15
"""Number of samples up to which compiling a fast program takes longer than what it saves in a few calls."""
OLDER_EMITTERS = {"xla_cpu_use_fusion_emitters": False}
"""XLA options: older emitters make equally fast programs of some hundred small kernels in two thirds of the time."""
LAPACK = b"lapack_"
"""Marks a program that calls LAPACK; it is not kept, because a process that only reads it would end at the call."""
_level: ContextVar[int] = ContextVar("_level", default=MANY_CALLS)
ADDRESS = " at 0x"
"""Marks the description of an object that only its memory address identifies; such a program is not kept."""


class KeptProgram:
    """A function of arrays, compiled once for all processes; called within another program, it becomes a part of it."""

    def __init__(self, function: Callable[..., Any], static: tuple[str, ...]) -> None:
        update_wrapper(self, function)
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._function = jax.jit(function, static_argnames=static)
        self._ready: dict[Hashable, Future[Callable[..., Any]]] = {}
        self._lock = Lock()

    def __call__(self, *arguments: Any, **static: Any) -> Any:
        """Call the kept program; within another program, trace the function."""
        leaves, tree = jax.tree.flatten(arguments)
        if any(isinstance(leaf, jax.core.Tracer) for leaf in leaves):
            return self._function(*arguments, **static)
        return self._program(leaves, tree, static)(*arguments)

    def prepare(self, *arguments: Any, **static: Any) -> Callable[..., Any]:
        """Load or compile the program for arguments of these shapes; it is called without the ``static`` ones."""
        return self._program(*jax.tree.flatten(arguments), static)

    def _program(self, leaves: list[Any], tree: Any, static: dict[str, Any]) -> Callable[..., Any]:
        shapes = shapes_of(leaves)
        identity = tree, shapes, tuple(static.items()), is_float64(), on_cpu()
        fast, asked = ((*identity, level) for level in (MANY_CALLS, _level.get()))
        with self._lock:
            key = fast if fast in self._ready else asked
            mine = key not in self._ready
            ready = self._ready.setdefault(key, Future())
        if mine:  # other threads that need it wait for this one
            try:
                ready.set_result(self._make(tree, shapes, static, f"{self._name} {key}"))
            except BaseException as error:
                del self._ready[key]
                ready.set_exception(error)
                raise
        return ready.result()

    def _make(self, tree: Any, shapes: Any, static: dict[str, Any], words: str) -> Callable[..., Any]:
        """Load the program from the cache, or compile it and store it there."""
        path = _path(words)

        def compiled() -> Callable[..., Any]:
            outline = jax.tree.unflatten(tree, [jax.ShapeDtypeStruct(*shape) for shape in shapes])

            def named(*arguments: Any) -> Any:
                return self._function(*arguments, **static)

            # The name is part of the key of JAX's own cache; a program loaded from there cannot be serialised again.
            named.__name__ = named.__qualname__ = path.stem if path else self._name
            program: Callable[..., Any] = _compile(jax.jit(named).lower(*outline))
            if path is not None:
                _keep(path, program)
            return program

        if path is not None and _is_own(path.parent):
            with suppress(Exception):  # a cached file may be invalid; the program is compiled again then
                kept: Callable[..., Any] = deserialize_and_load(*pickle.loads(_content(path)))
                _return_memory()
                return _tried(kept, compiled)
        return compiled()


def _compile(lowered: Any) -> Any:
    """Compile a lowered function."""
    try:
        chosen = {**OLDER_EMITTERS, "xla_backend_optimization_level": _level.get()} if on_cpu() else None
        return lowered.compile(compiler_options=chosen)
    except jax.errors.JaxRuntimeError:  # this version of XLA does not know the options
        return lowered.compile()
    finally:
        _return_memory()


def _tried(kept: Callable[..., Any], compiled: Callable[[], Callable[..., Any]]) -> Callable[..., Any]:
    """The loaded program, or a compiled one if its first call fails: missing functions show only when it is called."""
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
    """Compile quickly instead of for speed, in the block and in threads that it starts.

    This applies to SHORT ``samples`` or fewer; with more of them, slow programs lose more time than compiling saves.
    """
    before = _level.set(FEW_CALLS if samples <= SHORT else _level.get())
    try:
        yield
    finally:
        _level.reset(before)


def shapes_of(leaves: list[Any]) -> tuple[tuple[tuple[int, ...], np.dtype], ...]:
    """Shape and precision of each array or number, which are part of a program's key."""
    return tuple((np.shape(leaf), np.dtype(getattr(leaf, "dtype", type(leaf)))) for leaf in leaves)


def keep_program(*static: str) -> Callable[[Callable[..., Any]], KeptProgram]:
    """Decorator that keeps the compiled programs of a function of pytrees of arrays.

    The arguments named in ``static`` are part of the program and must be passed by keyword.
    """
    return lambda function: KeptProgram(function, static)


def _return_memory() -> None:
    """Return memory that compiling or loading no longer needs to the system: some 100 MB, which the C library keeps."""
    with suppress(Exception):  # only glibc has it
        ctypes.CDLL(None).malloc_trim(0)


def _keep(path: Path, compiled: Any) -> None:
    """Write a program to the cache."""
    with suppress(Exception):  # a full disk, or a program that cannot be serialised
        content = path.stem.encode() + pickle.dumps(serialize(compiled))
        if LAPACK in content:
            return
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        replace_whole(str(path), lambda file: file.write(content))


def _content(path: Path) -> bytes:
    """Read the serialised program of a file.

    Raises:
        OSError, ValueError: the file cannot be read, is no plain file of a sensible size, or holds another program.
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
    """Path of a program, from ``words`` for what it depends on besides package, versions and processor, or None."""
    config: Any = jax.config  # JAX's type hints lack its settings
    folder = config.jax_compilation_cache_dir
    if not folder or not config.jax_enable_compilation_cache or ADDRESS in words or not on_cpu():
        return None
    digest = hashlib.sha256(f"{_surroundings()} {words}".encode()).hexdigest()
    return Path(folder) / "ftbias" / f"{digest[:32]}.program"


def _is_own(folder: Path) -> bool:
    """Whether a folder of programs belongs to this user, and nobody else can write there.

    Loading a program means running it (and its shapes are a pickle), so files that others can write are not read.
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
    """Features of the processor, where the system lists them, because compiled code makes use of all of them."""
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return " ".join(sorted({line for line in lines if line.startswith(("flags", "Features", "model name"))}))
    return ""
