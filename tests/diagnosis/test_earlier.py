"""What earlier runs know: estimates and logs as information for the next design."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynident.case.case import read_case
from dynident.cli.main import main
from dynident.data.log import Log
from dynident.data.preprocessing import default_preprocessing
from dynident.diagnosis.earlier import check_same, noise_of, prior_of_estimate, prior_of_logs
from dynident.errors import BadOption
from dynident.excitation.design.prior import deviations_of
from dynident.identification.files.estimate_file import read_estimate, write_estimate
from dynident.identification.identify import identify
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot


@pytest.fixture(scope="module")
def model(planar_2r: Robot) -> DynamicModel:
    return DynamicModel(planar_2r, ("coulomb", "viscous"))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def logs(model: DynamicModel, exact_log: Callable[..., Log]) -> tuple[Log, ...]:
    assert model.robot.nominal is not None
    theta = np.append(model.robot.nominal, np.tile([0.5, 0.3], 2))
    made = [exact_log(model, theta, noise=0.1, seed=k, samples=2400, rate=200.0) for k in range(2)]
    return tuple(Log(log.joints, log.time, log.q, torque=log.torque) for log in made)


def test_logs_know_what_their_estimate_knows(model: DynamicModel, logs: tuple[Log, ...]) -> None:
    how = default_preprocessing()
    estimate = identify(model, logs, "wls", how)
    prior, noise = prior_of_logs(model, logs, estimate.preprocessing)
    np.testing.assert_allclose(noise, noise_of(estimate), rtol=0.01)
    # A correlation factor per joint here, the colour of each parameter's own scores in the estimate.
    share = deviations_of(prior.information) / estimate.std
    assert 0.8 < np.median(share) < 1.25 and np.all((share > 0.5) & (share < 2.0))
    assert prior.mean is not None
    np.testing.assert_allclose(prior.mean, estimate.beta, atol=0.02 * np.abs(estimate.beta).max())
    own = prior_of_estimate(estimate, model, "estimate.json")
    np.testing.assert_allclose(deviations_of(own.information), estimate.std, rtol=1e-6)


def test_two_logs_know_more_than_one(model: DynamicModel, logs: tuple[Log, ...]) -> None:
    how = default_preprocessing()
    one, both = (deviations_of(prior_of_logs(model, some, how)[0].information) for some in (logs[:1], logs))
    assert np.all(both < one)


def test_an_estimate_of_another_model_is_refused(model: DynamicModel, logs: tuple[Log, ...]) -> None:
    estimate = identify(model, logs, "wls", default_preprocessing())
    check_same(estimate, model, "estimate.json")
    with pytest.raises(BadOption, match=r"estimate.json = 'an estimate of other base parameters \(\d+ beside \d+"):
        prior_of_estimate(estimate, replace(model, friction=("viscous",)), "estimate.json")  # type: ignore[arg-type]


def test_the_hint_beside_an_estimate_of_more_joints_can_be_followed(
    model: DynamicModel, logs: tuple[Log, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commands of the message, word by word, give a case of the joints that are left."""
    monkeypatch.chdir(tmp_path)
    write_estimate(identify(model, logs, "consistent", default_preprocessing()), "my run.json")
    locked = replace(model, robot=model.robot.locked({model.robot.joint_names[1]: 0.3}))
    with pytest.raises(BadOption) as caught:
        prior_of_estimate(read_estimate("my run.json"), locked, "my run.json")
    assert "leave the estimate out" in str(caught.value)
    (command,) = re.findall(r"'dynident (export .*?identified.xml)'", str(caught.value))
    assert main([*shlex.split(command), "--quiet"]) == 0
    (robot,) = re.findall(r"state (robot: \S+) in the case", str(caught.value))
    Path("next.yaml").write_text(f"case: 2\n{robot}\nlocked: {{{model.robot.joint_names[1]}: 0.3}}\n")
    case = read_case("next.yaml")
    assert case.robot.joint_names == locked.robot.joint_names
    found, wanted = (base_parameters(replace(one, friction=locked.friction)) for one in (case.model, locked))
    assert found.names == wanted.names


def test_no_logs(model: DynamicModel) -> None:
    with pytest.raises(BadOption, match="earlier logs = 'none'"):
        prior_of_logs(model, (), default_preprocessing())
