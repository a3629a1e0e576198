"""Work in order on several threads."""

from __future__ import annotations

import threading

import pytest

from dynident.model.threads import in_order, usable_processors


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
