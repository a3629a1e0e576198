"""The tables of docs/benchmark.md are those of the scoreboard's JSON."""

from __future__ import annotations

import json

from benchmarks.scoreboard import BEGIN, DOCS, END, block, held_out


def test_the_tables_are_those_of_the_results() -> None:
    board = json.loads((DOCS / "assets" / "scoreboard.json").read_text(encoding="utf-8"))
    page = (DOCS / "benchmark.md").read_text(encoding="utf-8")
    assert page.partition(BEGIN)[2].partition(END)[0].strip() == block(board)


def test_failures_are_told_with_their_reason_and_the_best_stands_out() -> None:
    def result(method: str, error: float | None, why: str | None = None, possible: bool = True) -> dict[str, object]:
        return {"method": method, "test_error": error, "failure": why, "physically_consistent": possible}

    methods = [
        result("a", 0.0123),
        result("b", 0.2, possible=False),
        result("c", None, "late"),
        result("d", None, "late"),
    ]
    told = held_out({"sets": [{"name": "one", "methods": methods}, {"name": "none", "methods": []}]})
    assert "| `a` | **1.23** |" in told and "| `b` | 20\\* |" in told and "none" not in told
    assert "| `c` | (1) |" in told and "| `d` | (1) |" in told and told.endswith("- (1) late")
