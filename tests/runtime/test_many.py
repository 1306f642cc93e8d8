"""Many tasks in one call: results in order, errors by log, here or by executors, and reports of lost workers."""

from concurrent.futures import Executor, Future, ThreadPoolExecutor

import pytest

from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.runtime.many import do_all, do_each, results_of


class Lost(Executor):
    """An executor that loses every worker."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(RuntimeError("worker lost"))
        return future


def inverse(number):
    if not number:
        raise LogError("has no inverse", file="0.npz")
    return 1 / number


@pytest.fixture(params=["here", "threads"])
def executor(request):
    with ThreadPoolExecutor(2) as pool:
        yield pool if request.param == "threads" else None


def test_results_are_in_the_order_of_the_tasks_and_told_as_they_come(executor):
    told = []
    assert do_each(inverse, iter([1, 2, 4]), executor, told.append) == do_all(inverse, [1, 2, 4], executor)
    assert sorted(told) == [0.25, 0.5, 1.0]


def test_an_error_is_that_of_its_log_alone(executor):
    found = results_of(inverse, [2, 0, 4], executor)
    assert list(found) == [0.5, None, 0.25]
    assert (len(found), found[2], found[:2]) == (3, 0.25, (0.5, None))
    assert str(found) == "2 of 3 logs have a result\nlog 1 has no result: 0.npz: has no inverse"
    assert found.errors[1].file == "0.npz"


def test_what_is_no_error_of_a_log_ends_the_call(executor):
    with pytest.raises(TypeError):
        results_of(inverse, [1, "2"], executor)


def test_there_must_be_a_log(executor):
    with pytest.raises(UsageError, match=r"^logs: there is no log \("):
        results_of(inverse, [], executor)


def test_a_log_whose_workers_are_lost_has_an_error():
    assert do_each(inverse, [1, 2], Lost()) == [None, None]
    (error,) = results_of(str, ["a.npz"], Lost()).errors.values()
    assert str(error).startswith("a.npz: its workers died repeatedly")
    with pytest.raises(UsageError, match=r"^executor: its workers died"):
        do_all(inverse, [1, 2], Lost())
