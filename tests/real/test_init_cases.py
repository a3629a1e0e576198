"""Case files that ``dynident init`` drafts for real logs, against those written by hand; skipped without the logs."""

from __future__ import annotations

from pathlib import Path

import pytest

from loaded_file import loaded_file
from real_data import DATA, real

pytestmark = pytest.mark.battery

ROOT = Path(__file__).resolve().parents[2]


cases = loaded_file("benchmarks/init_cases.py")  # which has the answers


@pytest.mark.parametrize("name", list(cases.SETS))
def test_a_draft_is_as_good_as_the_case_written_by_hand(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Only what the draft asks for is filled in; both are compared under the filter of the hand-written case."""
    of = cases.SETS[name]
    real(of.robot, monkeypatch)
    found = cases.outcome_of(name, DATA, tmp_path)
    assert found.ratio <= cases.BOUND
    assert found.own <= cases.BOUND * found.by_hand
    assert found.asked <= found.answered <= found.asked + 1
