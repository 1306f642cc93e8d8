"""Processes on one or many machines that tune together: each reads its own logs, and only sums cross the network.

It uses JAX's own runtime: on CPUs processes communicate by gloo, on GPUs by NCCL; one process per device is intended.
"""

from collections.abc import Collection, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from ftbias_jax.errors import FtbiasError, LogError, UsageError


def start(coordinator: str | None = None, processes: int | None = None, process: int | None = None) -> None:
    """Join the other processes; call it before any array is created.

    Args:
        coordinator: HOST:PORT of process 0; None, like the other two, where JAX finds them itself (Slurm, Open MPI, a
            TPU pod).
        processes: number of processes.
        process: index of this process, counted from 0.

    Raises:
        UsageError: the processes are not known, or the others do not answer.
    """
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    try:
        jax.distributed.initialize(coordinator, processes, process)
    except (RuntimeError, ValueError) as error:
        remedy = "give --distributed HOST:PORT,PROCESSES,PROCESS, or start under Slurm or MPI"
        raise UsageError(f"cannot join the other processes: {error}", field="--distributed", remedy=remedy) from error


def share(paths: Sequence[str]) -> list[str]:
    """The logs of this process: every n-th one for n processes.

    Raises:
        UsageError: there are fewer logs than processes.
    """
    if len(paths) < jax.process_count():
        message = f"{len(paths)} logs for {jax.process_count()} processes"
        raise UsageError(message, field="--distributed", remedy="start at most one process a log")
    return list(paths[jax.process_index() :: jax.process_count()])


def agree(paths: Sequence[str], usable: Collection[str]) -> list[str]:
    """The usable ones of all logs, the same list for every process.

    Args:
        paths: paths of all logs.
        usable: paths of this process's logs that can be used.
    """
    counts = add(np.array([float(path in usable) for path in paths]))
    return [path for path, count in zip(paths, counts, strict=True) if count > 0]


def end_together(error: FtbiasError | None) -> None:
    """Go on only if every process can, because the others would wait for one that has ended.

    Args:
        error: why this process cannot go on; None = it can.

    Raises:
        FtbiasError: the given error, or that another process has one.
    """
    failed = add(np.array([float(error is not None)]))[0]
    if error is not None:
        raise error
    if failed:
        count = f"{failed:.0f} of {jax.process_count()} processes"
        raise LogError(f"{count} cannot go on", field="--distributed", remedy="each tells why in a line of its own")


def total(value: float, slopes: np.ndarray) -> tuple[float, np.ndarray]:
    """Sums over all processes of a likelihood and its gradients, bitwise the same on each of them: one psum."""
    sums = add(np.concatenate([[value], np.ravel(slopes)]))
    return float(sums[0]), sums[1:].reshape(np.shape(slopes))


def add(numbers: np.ndarray) -> np.ndarray:
    """Sum over all processes of one array per process."""
    mesh = jax.make_mesh((jax.device_count(),), ("device",))
    rows = np.zeros((jax.local_device_count(), len(numbers)))
    rows[0] = numbers
    parts = jax.make_array_from_process_local_data(NamedSharding(mesh, PartitionSpec("device")), rows)

    def of_all(row: Any) -> Any:
        return jax.lax.psum(row[0], "device")

    everywhere = jax.shard_map(of_all, mesh=mesh, in_specs=PartitionSpec("device"), out_specs=PartitionSpec())
    return np.asarray(jax.jit(everywhere)(parts))
