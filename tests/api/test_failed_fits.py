"""A fit that fails on a log with a fault: the message begins with what the checks have found."""

from __future__ import annotations

from dynident.api.log_checks import add_causes
from dynident.errors import SolverFailed


def test_the_cause_stands_before_what_followed_from_it() -> None:
    found = {"name": "positions in degrees", "joint": "j1", "evidence": "up to 105 rad", "remedy": "state the unit"}
    error = SolverFailed("the consistent fit", "no gap was proven", "use wls")
    plain = str(error)
    add_causes(error, [{"path": "run.csv", "findings": [found | {"severity": "warning"}]}])
    assert str(error) == plain
    add_causes(error, [{"path": "run.csv", "findings": [found | {"severity": "error"}]}])
    cause = "run.csv: positions in degrees (j1): up to 105 rad; state the unit"
    assert str(error) == f"the log checks found {cause}. With that, {plain}"
