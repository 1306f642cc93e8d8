"""Tasks given to executors: all are done, few at a time, again if a worker is lost; clusters, and local processes."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import jax.numpy as jnp
import pytest

import ftbias_jax
from ftbias_jax.errors import UsageError
from ftbias_jax.runtime.executors import MOST_TOGETHER, TRIES, executor_of, run_each, run_with


def doubled(number):
    return 2.0 * number, str(jnp.result_type(float))


class Losing(Executor):
    """An executor that loses the worker of some tasks repeatedly, and counts how many wait."""

    def __init__(self, losses):
        self.losses, self.flying, self.most = dict(losses), 0, 0

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.flying += 1
        self.most = max(self.most, self.flying)
        lost = [task for task in args[-1] if self.losses.get(task, 0)]
        if lost:
            self.losses[lost[0]] -= 1
            future.set_exception(RuntimeError("worker lost"))
        else:
            future.set_result(fn(*args))
        future.add_done_callback(lambda _: None)
        return future


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_every_task_is_done_in_double_precision(kind):
    pool = ThreadPoolExecutor(2) if kind == "threads" else ProcessPoolExecutor(2, mp_context=get_context("spawn"))
    with pool as executor:
        found = dict(run_with(executor, doubled, range(5), in_flight=2))
    assert found == {number: (2.0 * number, "float64") for number in range(5)}


def test_a_task_whose_worker_is_lost_is_done_again_and_given_up_in_the_end():
    found = dict(run_with(Losing({1: TRIES - 1, 2: TRIES}), str, range(4)))
    assert found == {0: "0", 1: "1", 2: None, 3: "3"}


def test_quick_tasks_go_together_and_each_by_itself_once_their_worker_is_lost():
    losing, bundles = Losing({10: 1, 20: TRIES}), []
    submit = losing.submit
    losing.submit = lambda fn, work, bundle: bundles.append(bundle) or submit(fn, work, bundle)
    found = dict(run_with(losing, str, range(50), in_flight=2, seconds=10.0))
    assert found == {number: None if number == 20 else str(number) for number in range(50)}
    assert max(map(len, bundles)) == MOST_TOGETHER
    assert [bundle for bundle in bundles if 10 in bundle][1:] == [(10,)]


def test_what_the_work_raises_is_raised_and_is_no_loss():
    losing = Losing({})
    with pytest.raises(ZeroDivisionError):
        list(run_with(losing, (1).__truediv__, [1, 0, 2], in_flight=1))
    assert losing.flying == 2


def test_a_call_that_cannot_be_sent_to_a_worker_is_no_lost_worker():
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor,
        pytest.raises(UsageError, match=r"cannot load the call.*lambda.*defined in a module"),
    ):
        list(run_with(executor, lambda number: number, range(2)))


def test_the_name_of_a_cluster_is_no_executor():
    with pytest.raises(UsageError, match=r"'dask', which is no executor.*get_executor"):
        list(run_with("dask", str, range(2)))


def test_only_so_many_tasks_are_taken_at_a_time():
    taken = []

    def tasks():
        for number in range(20):
            taken.append(number)
            yield number

    results = run_with(Losing({}), str, tasks(), in_flight=3)
    next(results)
    assert len(taken) == 3
    assert len(list(results)) == 19


def test_an_executor_that_is_shut_down_says_so():
    with ThreadPoolExecutor(1) as executor:
        pass
    with pytest.raises(UsageError, match="takes no more tasks"):
        list(run_with(executor, str, [1]))


@pytest.mark.parametrize("name", ["dask", "slurm:node", ""])
def test_unknown_clusters_are_refused(name):
    with pytest.raises(UsageError, match=r"give dask:tcp://HOST:PORT or ray"), executor_of(name):
        pass


@pytest.mark.slow
def test_ray_does_every_task():
    pytest.importorskip("ray", reason="Ray is not installed")
    with executor_of("ray") as executor:
        assert dict(run_with(executor, doubled, range(3))) == {n: (2.0 * n, "float64") for n in range(3)}


def killed(task):
    """Kill the process of one task, rather than fail."""
    if task == "deadly":
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGKILL)
    return task.upper()


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_task_has_its_result(jobs):
    assert dict(run_each(str.upper, "abcde", jobs)) == {letter: letter.upper() for letter in "abcde"}
    assert list(run_each(str.upper, [], jobs)) == []


def test_a_process_that_is_killed_takes_no_other_task_with_it():
    tasks = ["a", "deadly", "b", "c", "d"]
    found = list(run_each(killed, tasks, 2))
    assert len(found) == len(tasks)
    assert dict(found) == {"a": "A", "deadly": None, "b": "B", "c": "C", "d": "D"}


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_processes_end_with_a_parent_that_was_killed(tmp_path):
    """Each process reports its number, and would work on for minutes."""
    program = "import functools, os, sys; from ftbias_jax.runtime.executors import run_each\n"
    program += "if __name__ == '__main__': list(run_each(os.system, [f'echo $PPID >> {sys.argv[1]}; sleep 20'] * 2, 2))"
    path = os.path.dirname(os.path.dirname(ftbias_jax.__file__))
    told = tmp_path / "numbers"
    parent = subprocess.Popen([sys.executable, "-c", program, str(told)], env={**os.environ, "PYTHONPATH": path})
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline and (not told.exists() or len(told.read_text().split()) < 2):
        time.sleep(0.1)
    children = [int(number) for number in told.read_text().split()]
    assert len(children) == 2
    parent.kill()
    parent.wait()
    deadline = time.monotonic() + 15
    while time.monotonic() < deadline and any(map(alive, children)):
        time.sleep(0.1)
    assert not any(map(alive, children))
