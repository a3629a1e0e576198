"""The table of docs/performance.md is that of the files which the rows have left."""

from __future__ import annotations

import json

from benchmarks.speed.harness import Line, Record, in_turns
from benchmarks.speed.page import BEGIN, END, PAGE, RESULTS, ROWS, block, reached, read_results


def test_the_table_is_that_of_the_results() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text.partition(BEGIN)[2].partition(END)[0].strip() == block(read_results()).strip()
    assert {place.stem for place in RESULTS.glob("*.json")} - {"scaling"} <= set(ROWS)


def test_a_missing_peer_is_named_and_a_slower_side_does_not_reach() -> None:
    found = Record("row", "about")
    found.time({"here": lambda: sum(range(20_000)), "peer": lambda: sum(range(2_000))}, 3)
    assert found.peer("no_such_module") is None
    found.lines = [Line("slow", "here", "peer", 1.0), Line("alone", "here", "no_such_module", 1.0)]
    data = json.loads(json.dumps(found.data())) | {"machine": {}}
    slow, alone = data["lines"]
    assert slow["ratio"]["median"] < 1 and reached(slow) is False and reached(alone) is None
    assert "no_such_module" in data["missing"] and alone["peer"] == {"name": "no_such_module", "missing": True}


def test_sides_take_turns() -> None:
    order: list[str] = []
    times = in_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 2)
    assert [name for k, name in enumerate(order) if k == 0 or order[k - 1] != name] == ["a", "b", "a", "b"]
    assert all(len(one.processor) == len(one.wall) == 2 for one in times.values())
