"""Identified base parameters beside published ones; skipped where the logs are missing."""

from __future__ import annotations

import re

import pytest
from benchmarks import published_parameters

from real_data import DATA, real


@pytest.fixture
def data(monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("panda_gaz2019", "staubli_tx40_figaroh"):
        real(folder, monkeypatch)
    monkeypatch.setattr(published_parameters, "DATA", DATA)


def test_tx40_agrees_with_the_published_base_parameters(data: None, capsys: pytest.CaptureFixture[str]) -> None:
    published_parameters.tx40()
    text = capsys.readouterr().out
    found = re.search(r"(\d+) of 60 carried over; .* within 2 deviations: (\d+)%; not among ours: fs6", text)
    assert found is not None and int(found[1]) == 59 and int(found[2]) >= 95


@pytest.mark.battery
def test_panda_has_the_43_published_coefficients_and_possible_links(
    data: None, capsys: pytest.CaptureFixture[str]
) -> None:
    published_parameters.panda()
    text = capsys.readouterr().out
    rows = [line for line in text.splitlines() if re.match(r"\| (I|m)[a-z]+\[link", line)]
    assert len(rows) == 43
    assert "Broken conditions of the published parameters: 0" in text and "impossible" not in text
