"""The section on trust shows the diagnostics that the estimate carries, and is left out where there are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.identification.identify import identify
from dynident.identification.uncertainty.trust import TrustOptions
from dynident.identification.validate import validate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION
from dynident.model.robot import Robot
from dynident.results.report import write_report


def test_the_report_has_the_verdicts(planar_2r: Robot, exact_log: Callable[..., Log], tmp_path: Path) -> None:
    model = DynamicModel(planar_2r, (FRICTION.make("viscous"),))
    assert planar_2r.nominal is not None
    theta = np.append(planar_2r.nominal, [0.5, 0.7])
    log = exact_log(model, theta, noise=np.array([0.3, 0.1]))
    how = Preprocessing(AsGiven(), rest="keep")
    estimate = identify(model, [log], "wls", how, trust=TrustOptions(diagnose=True))
    fast = replace(log, dq=2 * np.asarray(log.dq), ddq=4 * np.asarray(log.ddq))
    write_report(tmp_path / "r.html", estimate, (validate(estimate, [fast]),))
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert ">Diagnostics<" in page and "Cross-validation over blocks (wls)" in page
    assert "extrapolation beyond the training range" in page and "Influence of parts of the logs" in page
    write_report(tmp_path / "plain.html", replace(estimate, diagnostics=None), ())
    assert ">Diagnostics<" not in (tmp_path / "plain.html").read_text(encoding="utf-8")
