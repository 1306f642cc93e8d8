import os
import signal
import subprocess
import sys
import time

import pytest

import ftbias_jax
from ftbias_jax.runtime.processes import run_each


def killed(task):
    """Not a task that fails, but one that takes its process down."""
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
    """Each tells its number, and would work on for minutes."""
    program = "import functools, os, sys; from ftbias_jax.runtime.processes import run_each\n"
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
