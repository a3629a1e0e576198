"""What the command line knows before a design: noise, the model of the torque limits, earlier runs."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING

from dynident.errors import BadOption

if TYPE_CHECKING:
    from dynident.arrays import Array
    from dynident.case.case import Case
    from dynident.excitation.design.observation import TorqueUncertainty
    from dynident.excitation.design.prior import Prior
    from dynident.identification.estimate.estimate import Estimate
    from dynident.model.dynamic_model import DynamicModel


@dataclass(frozen=True)
class Knowledge:
    """What is known before a design.

    Attributes:
        noise: Standard deviation of each joint's torque, shape (n,); None for the default.
        source: Where the noise comes from, in words; empty for the default.
        theta: Parameters of the torque limits, shape (p,); None for those of the robot model.
        uncertainty: Chance margin of the torque limits.
        model: Where the torque limits come from, in words; empty for the robot model.
        earlier: What earlier runs know.
        rate: Samples a second that the noise is of, where it comes from residuals; None: those of the case.
    """

    noise: Array | None = None
    source: str = ""
    theta: Array | None = None
    uncertainty: TorqueUncertainty | None = None
    model: str = ""
    earlier: Prior | None = None
    rate: float | None = None


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say what is known."""
    known = parser.add_argument_group("what is known before")
    known.add_argument(
        "--noise",
        nargs="+",
        type=float,
        metavar="X",
        help="standard deviation of the torque, one number or one a joint, in N m or N; default: 1 %% of each effort "
        "limit, or that of --earlier",
    )
    known.add_argument(
        "--noise-from", metavar="ESTIMATE", help="take the noise from the residuals of an estimate of this robot"
    )
    known.add_argument(
        "--model",
        metavar="ESTIMATE",
        help="compute torques with an estimate in place of the nominal masses, and keep --sigmas of its "
        "uncertainty free; a --torque-margin of 0.05 to 0.1 is then enough",
    )
    known.add_argument(
        "--sigmas", type=float, metavar="N", help="standard deviations of --model's torque that stay free (2); 0: none"
    )
    known.add_argument(
        "--earlier",
        metavar="ESTIMATE",
        help="what to record next: add what this estimate knows to the criterion and show what the run would buy",
    )
    known.add_argument(
        "--earlier-logs", nargs="+", default=[], metavar="LOG", help="the same from logs, prepared as the case says"
    )
    known.add_argument(
        "--rows",
        type=float,
        metavar="N",
        help="independent rows of each joint that the run will give, to weigh it against earlier runs; default: the "
        "case's samples a second times period times --repeats",
    )


def files_of(options: argparse.Namespace, case: Case) -> list[str]:
    """Return the files that the options name."""
    estimates = [name for name in (options.noise_from, options.model, options.earlier) if name]
    return [*estimates, *(str(case.find(name)) for name in options.earlier_logs)]


def knowledge_of(options: argparse.Namespace, case: Case, model: DynamicModel) -> Knowledge:
    """Return what the options say is known.

    Raises:
        DynidentError: A fault of a file, or options that do not go together.
    """
    for first, second in (("noise", "noise_from"), ("earlier", "earlier_logs")):
        if getattr(options, first) and getattr(options, second):
            name = second.replace("_", "-")
            raise BadOption(f"--{name}", getattr(options, second), f"it stands beside --{first}; give one of the two")
    if options.sigmas is not None and not options.model:
        raise BadOption("--sigmas", options.sigmas, "it needs --model, the estimate whose uncertainty it is about")
    earlier, noise, source, rate = _earlier(options, case, model)
    if options.noise is not None:
        noise, source, rate = _given(options.noise), "given", None
    if options.noise_from:
        from dynident.diagnosis.earlier import check_same, noise_of
        from dynident.identification.files.estimate_file import read_estimate

        estimate = read_estimate(options.noise_from)
        check_same(estimate, model, options.noise_from)
        noise, source, rate = noise_of(estimate), f"residuals of {options.noise_from}", _rows_a_second(estimate)
    theta, uncertainty = _model(options, model)
    return Knowledge(noise, source, theta, uncertainty, options.model or "", earlier, rate)


def _rows_a_second(estimate: Estimate) -> float | None:
    """Return how many samples a second the noise of an estimate is stated for."""
    rate = estimate.train.filter.get("rate_hz")
    return None if rate is None else float(rate)


def _given(noise: list[float]) -> Array:
    import numpy as np

    return np.array(noise[0] if len(noise) == 1 else noise)


def _earlier(
    options: argparse.Namespace, case: Case, model: DynamicModel
) -> tuple[Prior | None, Array | None, str, float | None]:
    """Return what earlier runs know, and their noise with its source and the samples a second that it is of."""
    if options.earlier:
        from dynident.diagnosis.earlier import noise_of, prior_of_estimate
        from dynident.identification.files.estimate_file import read_estimate

        estimate = read_estimate(options.earlier)
        prior = prior_of_estimate(estimate, model, options.earlier)
        return prior, noise_of(estimate), f"residuals of {options.earlier}", _rows_a_second(estimate)
    if options.earlier_logs:
        from dynident.diagnosis.earlier import prior_of_logs
        from dynident.identification.selection.cutoff.choice import with_cutoff

        logs = [case.read(name) for name in options.earlier_logs]
        how, _ = with_cutoff(model, logs, case.preprocessing)
        prior, noise = prior_of_logs(model, logs, how)
        resting = [name for name, level in zip(model.robot.joint_names, noise, strict=True) if not level > 0]
        if resting and options.noise is None and not options.noise_from:
            step = f"{', '.join(resting)} never moved in them, so its noise is not known; give --noise"
            raise BadOption("--earlier-logs", prior.source, step)
        return prior, noise, f"residuals of {prior.source}", how.rows_hz(logs[0].rate) or logs[0].rate
    return None, None, "", None


def _model(options: argparse.Namespace, model: DynamicModel) -> tuple[Array | None, TorqueUncertainty | None]:
    """Return the parameters of the torque limits and their chance margin."""
    if not options.model:
        return None, None
    from dynident.diagnosis.earlier import check_same
    from dynident.excitation.design.observation import TorqueUncertainty
    from dynident.identification.files.estimate_file import read_estimate

    estimate = read_estimate(options.model)
    check_same(estimate, model, options.model)
    theta = estimate.base.to_standard(estimate.beta) if estimate.theta is None else estimate.theta
    sigmas = 2.0 if options.sigmas is None else options.sigmas
    if not sigmas >= 0:
        raise BadOption("--sigmas", sigmas, "give 0 or more")
    return theta, TorqueUncertainty(estimate.covariance, sigmas) if sigmas else None
