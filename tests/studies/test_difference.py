"""Estimates side by side: what is the same is zero, what is not is found, and what cannot be compared is said."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.cli.main import main
from dynident.data.log import Log
from dynident.data.preprocessing import Preprocessing
from dynident.data.preprocessing.as_given import AsGiven
from dynident.errors import BadOption
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.files.estimate_file import write_estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction
from dynident.model.friction.coulomb import Coulomb
from dynident.model.friction.viscous import Viscous
from dynident.model.robot import Robot
from dynident.studies.comparison.difference_page import difference

GIVEN = Preprocessing(AsGiven(), rest="keep")

Made = Callable[..., Estimate]


@pytest.fixture(scope="module")
def made(planar_2r: Robot, exact_log: Callable[..., Log]) -> Made:
    """Make an estimate of the arm with a Coulomb friction of its second joint."""

    def make(seed: int, stick: float = 1.0, friction: tuple[Friction, ...] = (Coulomb(0.05), Viscous())) -> Estimate:
        model = DynamicModel(planar_2r, friction)
        assert planar_2r.nominal is not None
        names = [p.symbol + p.owner for p in model.parameters[model.inertial_count :]]
        tail = np.array([{"Fcjoint2": stick}.get(name, 0.7) for name in names])
        log = exact_log(model, np.append(planar_2r.nominal, tail), noise=0.2, samples=800, seed=seed)
        return identify(model, [log], "wls", GIVEN)

    return make


def test_two_runs_of_one_robot_agree_within_their_deviations(made: Made) -> None:
    found = difference([made(0), made(1)], ["a", "b"])
    gaps = np.array([each.gaps[1] for each in found.shared])
    assert len(gaps) == found.estimates[0].base.count and not found.alone
    assert np.all(gaps != 0) and np.sqrt(np.mean(gaps**2)) == pytest.approx(1.0, abs=0.6)
    assert found.torques is not None and np.all(found.torques.gaps[1] < 0.02 * found.torques.sizes[0])
    assert np.all(found.torques.gaps[0] == 0)


def test_what_changed_is_found(made: Made) -> None:
    found = difference([made(0), made(1, stick=3.0)], ["a", "b"])
    far = [each.name for each in found.shared if abs(each.gaps[1]) > 6]
    assert far == ["Fc[joint2]"]
    assert found.torques is not None and found.torques.gaps[1, 1] == pytest.approx(2.0, rel=0.2)


def test_an_estimate_beside_itself_is_no_difference(made: Made) -> None:
    one = made(0)
    found = difference([one, one, one], ["a", "b", "c"])
    assert all(np.all(each.gaps == 0) for each in found.shared)
    assert found.torques is not None and np.all(found.torques.gaps == 0)


def test_what_only_one_has_and_what_cannot_be_compared_is_said(made: Made, spatial_3r: Robot) -> None:
    whole, bare = made(0), made(0, friction=(Coulomb(0.05),))
    found = difference([whole, bare], ["whole", "bare"])
    assert found.alone == {"whole": ("Fv[joint1]", "Fv[joint2]")}
    old = replace(bare, envelope=None)
    assert "bare: the file does not state its training range" in difference([whole, old], ["whole", "bare"]).why_not
    envelope = whole.envelope
    assert envelope is not None
    away = replace(whole, envelope=replace(envelope, low=np.asarray(envelope.high) + 1.0, high=envelope.high + 2.0))
    apart = difference([whole, away], ["whole", "away"])
    assert apart.torques is None and apart.why_not.startswith("their logs have no ")
    with pytest.raises(BadOption, match="two or more"):
        difference([whole], ["whole"])
    other = replace(whole, model=DynamicModel(spatial_3r, whole.model.friction))
    with pytest.raises(BadOption, match="its joints are joint1, joint2, joint3, those of a joint1, joint2"):
        difference([whole, other], ["a", "b"])


def test_the_command_prints_tables_json_and_a_page(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_estimate(made(0), "monday.json")
    write_estimate(made(1, stick=3.0), "<b>friday.json")
    assert main(["diff", "monday.json", "<b>friday.json", "--html", "page.html"]) == 0
    shown = capsys.readouterr().out
    assert "base parameter" in shown and "joint2" in shown and "more than 3 deviations" in shown
    page = Path("page.html").read_text()
    assert (
        "<b>friday" not in page and "&lt;b&gt;friday" in page and "http://" not in page.replace("http://www.w3.org", "")
    )
    assert page.count("<svg") == 2
    assert main(["diff", "monday.json", "<b>friday.json", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert page.count('class="sum"') == len(data["parameters"]) > 2  # combinations as mathematics
    assert [each["name"] for each in data["estimates"]] == ["monday", "<b>friday"]
    assert data["torques"][1]["rms_gap"][1] > 1.0 and data["why_no_torques"] is None
    assert main(["diff", "monday.json"]) == 1
    assert "give two or more estimates" in capsys.readouterr().err
