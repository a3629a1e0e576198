"""Work in order on several threads."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from dynident.model.threads import in_order, one_blas_thread, usable_processors


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_results_come_in_the_order_of_the_items_and_few_are_ahead(threads: int) -> None:
    taken, late = list[int](), threading.Event()

    def items() -> list[int]:
        return list(range(40))

    def work(item: int) -> int:
        taken.append(item)
        if item == 3:
            late.wait(0.05)  # those behind it are done first
        return item * item

    for number, found in enumerate(in_order(work, items(), threads)):
        assert found == number * number
        assert len(taken) <= number + 1 + threads + (threads > 1)
    assert sorted(taken) == items()


@pytest.mark.parametrize("threads", [1, 3])
def test_a_fault_of_one_item_reaches_the_caller_after_those_before_it(threads: int) -> None:
    def work(item: int) -> int:
        if item == 5:
            raise ValueError("item 5")
        return item

    seen = list[int]()
    with pytest.raises(ValueError, match="item 5"):
        for found in in_order(work, range(100), threads):
            seen.append(found)
    assert seen == [0, 1, 2, 3, 4]
    assert usable_processors() >= 1


def test_threads_end_where_the_caller_stops_early() -> None:
    found = in_order(abs, range(100), 3)
    assert next(found) == 0
    del found
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("ThreadPool")]


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_blas_has_one_thread_until_the_outermost_call_ends() -> None:
    with threadpool_limits(2, "blas"):
        assert blas_threads() == {2}
        with one_blas_thread():
            with one_blas_thread():
                assert blas_threads() == {1}
            assert blas_threads() == {1}
            with pytest.raises(ValueError), one_blas_thread():
                raise ValueError
            assert blas_threads() == {1}
        assert blas_threads() == {2}


def test_a_library_that_is_loaded_inside_is_held_by_the_next_call() -> None:
    """SciPy brings a BLAS of its own, at its own number of threads."""
    code = """
import numpy
from threadpoolctl import threadpool_info, threadpool_limits
from dynident.model.threads import one_blas_thread

def threads():
    return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

with one_blas_thread():
    assert threads() == [1]
    import scipy.linalg
    before = threads()
    with one_blas_thread():
        assert threads() == [1] * len(before), threads()
    assert threads() == before
assert set(threads()) == {2}, threads()
"""
    done = subprocess.run([sys.executable, "-c", code], env=os.environ | {"OPENBLAS_NUM_THREADS": "2"}, check=False)
    assert done.returncode == 0


def test_another_thread_has_one_blas_thread_of_its_own() -> None:
    """It is limited though this one is, and leaves this one limited when it ends."""
    with threadpool_limits(2, "blas"), one_blas_thread():
        found = list[set[int]]()

        def other() -> None:
            with one_blas_thread():
                found.append(blas_threads())

        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        assert found == [{1}] and blas_threads() == {1}
