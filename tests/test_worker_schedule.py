"""List scheduling of the scaling plot: closed forms, bounds, and a brute-force clock."""

from __future__ import annotations

import pytest
from benchmarks.speed.worker_schedule import WORKERS, Costs, schedule
from hypothesis import given
from hypothesis import strategies as st

TIMES = st.lists(st.integers(1, 40), min_size=1, max_size=12)


def test_equal_tasks_go_in_rounds() -> None:
    costs = Costs(2.0, 3.0, (10.0,) * 7, (0.0,) * 7, 1.0)
    assert [schedule(costs, workers) for workers in (1, 2, 3, 7, 50)] == [76.0, 46.0, 36.0, 16.0, 16.0]


def test_one_worker_waits_for_the_command_between_its_tasks() -> None:
    assert schedule(Costs(1.0, 2.0, (5.0, 6.0), (0.5, 0.25), 0.125), 1) == 1 + 2 + 5 + 0.5 + 6 + 0.25 + 0.125


def test_with_many_workers_the_command_takes_one_result_after_the_other() -> None:
    costs = Costs(0.0, 0.0, (1.0,), (0.5,), 0.0).repeated(100)
    assert schedule(costs, 100) == schedule(costs, 1000) == 1.0 + 100 * 0.5
    assert len(costs.tasks) == len(costs.takes) == 100


@given(TIMES, st.integers(0, 3), st.sampled_from(WORKERS))
def test_grahams_bounds(tasks: list[int], take: int, workers: int) -> None:
    """No schedule is shorter than its longest part; a free worker never stands by while a task waits."""
    costs = Costs(1.0, 1.0, tuple(map(float, tasks)), (float(take),) * len(tasks), 1.0)
    found = schedule(costs, workers)
    least = max(max(tasks) + take, sum(tasks) / workers, take * len(tasks))
    assert 3.0 + least <= found <= 3.0 + sum(tasks) / workers + max(tasks) + take * len(tasks)
    assert found <= schedule(costs, 1)


@given(TIMES, st.integers(0, 3), st.integers(1, 4))
def test_against_a_clock_that_ticks(tasks: list[int], take: int, workers: int) -> None:
    costs = Costs(0.0, 2.0, tuple(map(float, tasks)), (float(take),) * len(tasks), 0.0)
    assert schedule(costs, workers) == pytest.approx(_ticked(tasks, take, workers, 2))


def _ticked(tasks: list[int], take: int, workers: int, start: int) -> int:
    """Return when all is done by workers and a command that are looked at once a second."""
    waiting, ready, taken, free, clock = list(enumerate(tasks)), list[tuple[int, int]](), 0, 0, 0
    ends = {}
    for _ in range(min(workers, len(waiting))):
        number, length = waiting.pop(0)
        ends[number] = start + length
    taking: int | None = None
    while True:
        ready += sorted((end, number) for number, end in ends.items() if end == clock)
        while True:
            if taking is not None and free == clock:
                taken, taking = taken + 1, None
                if waiting:
                    number, length = waiting.pop(0)
                    ends[number] = clock + length
            if taking is None and ready:
                taking, free = ready.pop(0)[1], clock + take
                if take == 0:
                    continue
            break
        if taken == len(tasks):
            return clock
        clock += 1
