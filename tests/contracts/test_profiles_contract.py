"""What every profile of a maker's log must do: a log under its columns is read, by name and not by place."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from dynident.arrays import Array
from dynident.case.log_section import profile_columns
from dynident.data.formats import ColumnMap, read_log
from dynident.data.formats._units import QUANTITY, UNITS
from dynident.data.log import Log
from dynident.data.profiles import PROFILES, unmeasured
from dynident.errors import BadOption, DynidentError

JOINTS = ("base", "elbow", "wrist")
ROWS = 40


def columns_of(name: str) -> ColumnMap:
    """Return the columns by a profile, with a unit for what only the user knows."""
    open_units = {
        QUANTITY[channel.signal]: UNITS[QUANTITY[channel.signal]]
        for channel in PROFILES.make(name).read_channels().values()
        if not channel.unit
    }
    return profile_columns(name, JOINTS, {quantity: next(iter(units)) for quantity, units in open_units.items()})


def table(name: str, seed: int = 0) -> dict[str, Array]:
    """Return all columns that the profile reads, with random values and a time in its unit."""
    generator, profile = np.random.default_rng(seed), PROFILES.make(name)
    (above, below), _ = UNITS["time"][profile.time_unit]
    step = 0.01 * below / above
    found = {profile.time: np.arange(ROWS) * step}
    for channel in profile.read_channels().values():
        found |= {column: generator.normal(size=ROWS) for column in channel.names(JOINTS)}
    return found


def written(path: Path, columns: dict[str, Array]) -> Path:
    rows = [
        ",".join(columns),
        *(",".join(f"{value:.17g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def signals(log: Log) -> dict[str, Array]:
    names = (f.name for f in fields(log))
    return {name: np.asarray(value) for name in names if isinstance(value := getattr(log, name), np.ndarray)}


@pytest.fixture(params=PROFILES.names())
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def test_a_log_under_its_columns_is_read_whole(name: str, tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "run.csv", table(name)), columns_of(name))
    read = PROFILES.make(name).read_channels()
    assert log.joints == JOINTS and len(log.time) == ROWS
    np.testing.assert_allclose(np.diff(log.time), 0.01, rtol=1e-9)
    for signal in read:
        values = signals(log)[signal]
        assert values.shape == (ROWS, len(JOINTS)) and np.all(np.isfinite(values))
        ratio = values / np.stack([table(name)[column] for column in read[signal].names(JOINTS)], axis=1)
        np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)  # one unit for all, and each in its place


def test_columns_are_found_by_name_and_joints_keep_theirs(name: str, tmp_path: Path) -> None:
    columns = table(name, 1)
    shuffled = {key: columns[key] for key in np.random.default_rng(0).permutation(list(columns))}
    plain, other = (
        read_log(written(tmp_path / f"{k}.csv", one), columns_of(name)) for k, one in enumerate((columns, shuffled))
    )
    assert signals(plain).keys() == signals(other).keys()
    for key, values in signals(plain).items():
        np.testing.assert_array_equal(signals(other)[key], values)


def test_a_foreign_column_changes_nothing(name: str, tmp_path: Path) -> None:
    columns = table(name, 2)
    plain = read_log(written(tmp_path / "a.csv", columns), columns_of(name))
    more = read_log(written(tmp_path / "b.csv", {**columns, "remark": np.zeros(ROWS)}), columns_of(name))
    for key, values in signals(plain).items():
        np.testing.assert_array_equal(signals(more)[key], values)


def test_positions_are_needed_and_named_when_they_lack(name: str, tmp_path: Path) -> None:
    columns = table(name)
    lost = PROFILES.make(name).read_channels()["q"].names(JOINTS)[1]
    del columns[lost]
    with pytest.raises(DynidentError) as caught:
        read_log(written(tmp_path / "run.csv", columns), columns_of(name))
    assert lost in str(caught.value) and "\n" not in str(caught.value)


def test_values_that_are_no_numbers_are_refused_with_their_place(name: str, tmp_path: Path) -> None:
    columns = table(name)
    column = PROFILES.make(name).read_channels()["q"].names(JOINTS)[2]
    columns[column] = np.where(np.arange(ROWS) == 7, np.nan, columns[column])
    with pytest.raises(DynidentError) as caught:
        read_log(written(tmp_path / "run.csv", columns), columns_of(name))
    assert column in str(caught.value) or "wrist" in str(caught.value)
    assert "9" in str(caught.value) and "\n" not in str(caught.value)  # the line, the header being line 1


def test_what_is_not_measured_is_never_offered_as_measured(name: str) -> None:
    for channel in PROFILES.make(name).channels:
        for column in channel.names(JOINTS):
            found = unmeasured(column)
            assert (found is None) == (channel.kind == "measured") or channel.signal in ("q_ref", "dq_ref"), column


def test_a_unit_that_only_the_user_knows_is_asked_for(name: str) -> None:
    if all(channel.unit for channel in PROFILES.make(name).read_channels().values()):
        assert profile_columns(name, JOINTS) == columns_of(name)
        return
    with pytest.raises(BadOption):
        profile_columns(name, JOINTS)


def test_a_profile_is_pure(name: str) -> None:
    assert columns_of(name) == columns_of(name)
    assert PROFILES.make(name).read_channels() == PROFILES.make(name).read_channels()
