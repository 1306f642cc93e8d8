import os
import signal
import time

import pytest

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
