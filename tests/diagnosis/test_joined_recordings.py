"""Recordings joined under one clock are told, and logs that only look so are not."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2]))  # the clean logs are those of the benchmark

from benchmarks.faults.trials import Trial, virtual

from dynident.case.case import Case
from dynident.diagnosis.checks.joined_recordings import joined_at

RATE = 100.0

#: Rows of an episode.
ROWS = 400


@pytest.fixture(scope="module")
def trial(case: Case) -> Trial:
    return virtual(case, rate=RATE)


@pytest.fixture(scope="module")
def joined(case: Case, trial: Trial) -> Trial:
    """Return four episodes of one robot whose clock runs on."""
    parts = [trial, *(virtual(case, seed, RATE) for seed in (1, 2, 3))]
    columns = {key: np.concatenate([part.columns[key][:ROWS] for part in parts]) for key in trial.columns}
    columns["t"] = np.arange(len(columns["t"])) / RATE
    return Trial(case, columns)


def test_joined_episodes_are_told_with_their_rows_and_in_place_of_what_follows(joined: Trial, tmp_path: Path) -> None:
    found = joined.examined(tmp_path)
    grave = [one for one in found.findings if one.severity != "note"]
    assert [(one.severity, one.name) for one in grave] == [("error", "joined recordings")]
    assert "row 401, row 801, row 1201: " in grave[0].evidence
    assert "train: [first.csv, second.csv]" in grave[0].remedy and grave[0].numbers["places"] == 3
    assert not found.sound and "a fit were left out: fix joined recordings" in found.left_out


def test_rows_in_any_order_of_their_signs_and_units_are_the_same(joined: Trial) -> None:
    t, q = joined.columns["t"], joined.columns["q"]
    for turned in (q, -np.rad2deg(q), q[:, ::-1]):
        assert joined_at(t, turned)[0].tolist() == [ROWS, 2 * ROWS, 3 * ROWS]
    assert joined_at(t, q, np.full(3, 2.0))[0].tolist() == [ROWS, 2 * ROWS, 3 * ROWS]
    assert joined_at(t, q[:, :1])[0].tolist() == []  # of one joint its counter may have been reset
    pauses = t + 2.0 * (np.arange(len(t)) // ROWS)
    assert joined_at(pauses, q)[0].tolist() == []  # in two seconds it may go anywhere: a gap in time


@pytest.mark.parametrize("rest", [0, 5, 20])
def test_episodes_that_end_at_rest_are_told(rest: int) -> None:
    """An encoder at rest repeats its position: the row before the jump is the same as those before it."""
    share = np.clip(np.arange(ROWS) / (ROWS - rest), 0, 1)
    way = np.outer(share**3 * (10 - 15 * share + 6 * share**2), [1.0, -0.7, 0.5])
    starts = np.array([[0.0, 0.0, 0.0], [-0.5, 0.3, 0.1], [0.4, 0.9, -1.0]])
    q = np.round(np.concatenate([way + start for start in starts]) / 1e-3) * 1e-3
    assert joined_at(np.arange(len(q)) / RATE, q)[0].tolist() == [ROWS, 2 * ROWS]


def test_a_right_log_is_silent_however_it_was_recorded(trial: Trial) -> None:
    t, q = trial.columns["t"], trial.columns["q"]
    generator = np.random.default_rng(0)
    kept = generator.random(len(t)) > 0.3
    bridged = (np.arange(len(t)) % 500) > 60
    held = np.repeat(q[::10], 10, axis=0)[: len(t)]
    frozen = ((np.arange(len(t)) > 700) & (np.arange(len(t)) < 730))[:, None] & [True, True, False]
    late = np.maximum.accumulate(t + np.abs(generator.standard_t(2, size=len(t))) / RATE) + 1e-7 * np.arange(len(t))
    for name, time, positions in (
        ("as it is", t, q),
        *((f"one of {k}", t[::k], q[::k]) for k in (2, 5, 10, 25)),
        ("coarse encoders", t, np.round(q / 0.05) * 0.05),
        ("noise", t, q + 1e-3 * generator.normal(size=q.shape)),
        ("lost rows", t[kept], q[kept]),
        ("gaps", t[bridged], q[bridged]),
        ("coarse clock", np.floor(t / 0.04) * 0.04 + 1e-6 * np.arange(len(t)), q),
        ("time of arrival", late, q),
        ("positions held", t, held),
        ("two joints held for a while", t, np.where(frozen, q[700], q)),
        ("a spike of all joints", t, q + (np.arange(len(t)) == 700)[:, None]),
        ("twelve rows", t[:12], q[:12]),
        ("at rest", t, np.zeros_like(q)),
    ):
        assert joined_at(time, positions)[0].tolist() == [], name
        assert joined_at(time, positions, np.full(3, 1e-3))[0].tolist() == [], name
