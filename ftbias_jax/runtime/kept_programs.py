"""Programs that stay compiled between processes, and need not even be traced again.

JAX keeps what XLA compiled, under a name that is known only after the program was traced and lowered. That takes a
second for a long program, in every process. Here the name is made of what a program depends on: the function, shapes
and precision of its arguments, the sources of this package, versions and processor. So a program that was ever compiled
is loaded and called.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import stat
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from functools import lru_cache, partial, update_wrapper
from importlib.metadata import version
from pathlib import Path
from threading import Lock, Thread
from typing import Any

import jax
import numpy as np
from jax.experimental.serialize_executable import deserialize_and_load, serialize

from ftbias_jax.files import replace_whole
from ftbias_jax.runtime.compiled_loops import on_cpu
from ftbias_jax.runtime.jax_config import is_plain, is_wide, same_precision

QUICK_TO_COMPILE: dict[str, str | bool] = {"xla_cpu_use_fusion_emitters": False}
"""The older emitters of XLA make equally fast programs of some hundred small kernels in two thirds of the time."""
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
        shapes = tuple((np.shape(leaf), np.dtype(getattr(leaf, "dtype", type(leaf)))) for leaf in leaves)
        key = (tree, shapes, tuple(static.items()), is_wide())
        with self._lock:
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
        if path is not None and _is_own(path.parent):
            with suppress(Exception):  # a file of a cache may be anything: then it is made again
                kept: Callable[..., Any] = deserialize_and_load(*pickle.loads(_content(path)))
                return kept
        outline = jax.tree.unflatten(tree, [jax.ShapeDtypeStruct(*shape) for shape in shapes])

        def named(*arguments: Any) -> Any:
            return self._function(*arguments, **static)

        # JAX's own cache knows it by this name: of what it has loaded from there no copy can be made.
        named.__name__ = named.__qualname__ = path.stem if path else self._name
        lowered = jax.jit(named).lower(*outline)
        try:
            compiled = lowered.compile(compiler_options=QUICK_TO_COMPILE if on_cpu() else None)
        except jax.errors.JaxRuntimeError:  # a version of XLA that does not know the option
            compiled = lowered.compile()
        if path is not None:
            _postponed.do(same_precision(partial(_keep, path, compiled, outline)))
        return compiled


class _Postponed:
    """Work that is done at once, or while blocks of ``kept_later`` run after the last of them."""

    def __init__(self) -> None:
        self._lock, self._blocks = Lock(), 0
        self._waiting: list[Callable[[], None]] = []

    def do(self, work: Callable[[], None]) -> None:
        with self._lock:
            if self._blocks:
                self._waiting.append(work)
                return
        work()

    def begin(self) -> None:
        with self._lock:
            self._blocks += 1

    def end(self) -> None:
        with self._lock:
            self._blocks -= 1
            if self._blocks:
                return
            waiting, self._waiting = self._waiting, []
        if waiting:
            Thread(target=_do_all, args=(waiting,)).start()


def _do_all(works: list[Callable[[], None]]) -> None:
    for work in works:
        work()


_postponed = _Postponed()


@contextmanager
def kept_later() -> Iterator[None]:
    """What is compiled in the block, by whatever thread, is written to the cache after it, by a thread of its own.

    Whoever waits for programs need not wait until they are written; only the end of the process does.
    """
    _postponed.begin()
    try:
        yield
    finally:
        _postponed.end()


def keep_program(*static: str) -> Callable[[Callable[..., Any]], KeptProgram]:
    """Make a function of trees of arrays a program that is kept.

    Args:
        static: names of arguments that are part of the program; they are given by name.
    """
    return lambda function: KeptProgram(function, static)


def _keep(path: Path, compiled: Any, outline: Any) -> None:
    """Write a program that works when it is read again."""
    with suppress(Exception):  # a full disk, or a program that cannot be kept
        parts, zeros = serialize(compiled), jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), outline)
        jax.block_until_ready(deserialize_and_load(*parts)(*zeros))
        content = path.stem.encode() + pickle.dumps(parts)
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
    """Where a program is kept; None = nowhere.

    Args:
        words: all that it depends on beside package, versions and processor.
    """
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
