"""Estimates of one robot side by side: parameters in units of their deviations, torques where all have seen motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynident.arrays import Array, finite
from dynident.data.log import Log
from dynident.errors import BadOption, DynidentError
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.problem.regressor_stream import RegressorStream

#: Random states on which torques are compared.
STATES = 1000

_QUANTITIES = ("position", "speed", "acceleration")


@dataclass(frozen=True)
class SharedParameter:
    """A base parameter that several estimates have.

    Attributes:
        name: Of the base parameter.
        unit: Of its values.
        values: One for each estimate, NaN where it has none, shape (k,).
        deviations: Standard deviations, shape (k,).
    """

    name: str
    unit: str
    values: Array
    deviations: Array

    @property
    def gaps(self) -> Array:
        """Difference to the first estimate over the deviation of both as if they were independent, shape (k,)."""
        spread = np.hypot(self.deviations, self.deviations[0])
        gap = self.values - self.values[0]
        return np.divide(gap, spread, out=np.where(gap == 0, 0.0, np.nan * gap), where=spread > 0)


@dataclass(frozen=True)
class TorqueGap:
    """Predicted torques on random states within what the logs of all estimates have seen.

    Attributes:
        sizes: Root mean square of the torque of each estimate and joint, shape (k, n).
        gaps: Root mean square of its difference to that of the first, shape (k, n).
    """

    sizes: Array
    gaps: Array


@dataclass(frozen=True)
class EstimateDifference:
    """Estimates of one robot side by side; the first is the one that the others are compared with.

    Attributes:
        names: Of the estimates.
        estimates: The estimates.
        shared: Base parameters that at least two have, in the order of the first.
        alone: Base parameters that only one has, by name of the estimate.
        torques: None where no motion is common to their logs.
        why_not: Why there are no torques; empty where there are.
    """

    names: tuple[str, ...]
    estimates: tuple[Estimate, ...]
    shared: tuple[SharedParameter, ...]
    alone: dict[str, tuple[str, ...]]
    torques: TorqueGap | None
    why_not: str

    def figures(self) -> dict[str, Any]:
        """Return the difference as plain data, fractions for shares."""
        first = self.estimates[0]
        joints = first.model.robot.joint_names
        return {
            "robot": first.model.robot.name,
            "estimates": [
                {
                    "name": name,
                    "estimator": each.estimator,
                    "samples": each.samples,
                    "logs": list(each.train.logs),
                    "base_parameters": each.base.count,
                    "training_error": finite(each.train.total_relative_error),
                    "physically_consistent": each.consistency.consistent,
                }
                for name, each in zip(self.names, self.estimates, strict=True)
            ],
            "parameters": [
                {
                    "name": each.name,
                    "unit": each.unit,
                    "values": [finite(v) for v in each.values],
                    "std": [finite(v) for v in each.deviations],
                    "t": [finite(v) for v in each.gaps],
                }
                for each in self.shared
            ],
            "only_in": {name: list(alone) for name, alone in self.alone.items()},
            "torques": None
            if self.torques is None
            else [
                {"joint": joint, "rms": self.torques.sizes[:, i].tolist(), "rms_gap": self.torques.gaps[:, i].tolist()}
                for i, joint in enumerate(joints)
            ],
            "why_no_torques": self.why_not or None,
        }


def difference(estimates: Sequence[Estimate], names: Sequence[str], seed: int = 0) -> EstimateDifference:
    """Return estimates of one robot side by side.

    Args:
        estimates: Two or more; the others are compared with the first.
        names: A name for each.
        seed: Of the random states.

    Raises:
        BadOption: Fewer than two, names that are not one each, or another robot's joints.
    """
    if len(estimates) < 2 or len(names) != len(estimates):
        raise BadOption("estimates", len(estimates), "give two or more estimates, with a name for each")
    joints = estimates[0].model.robot.joint_names
    for name, estimate in zip(names[1:], estimates[1:], strict=True):
        own = estimate.model.robot.joint_names
        if own != joints:
            step = f"its joints are {', '.join(own)}, those of {names[0]} {', '.join(joints)}; compare one robot's"
            raise BadOption("estimates", name, step)
    shared, alone = _parameters(estimates, names)
    torques, why_not = _torques(estimates, names, seed)
    return EstimateDifference(tuple(names), tuple(estimates), shared, alone, torques, why_not)


def _parameters(
    estimates: Sequence[Estimate], names: Sequence[str]
) -> tuple[tuple[SharedParameter, ...], dict[str, tuple[str, ...]]]:
    facts = [zip(each.base.units, each.beta, each.std, strict=True) for each in estimates]
    own = [dict(zip(each.base.names, rows, strict=True)) for each, rows in zip(estimates, facts, strict=True)]
    everything = list(dict.fromkeys(name for each in own for name in each))
    shared = []
    for name in everything:
        found = [each.get(name) for each in own]
        known = [item for item in found if item is not None]
        if len(known) < 2:
            continue
        values = np.array([np.nan if item is None else item[1] for item in found])
        deviations = np.array([np.nan if item is None else item[2] for item in found])
        shared.append(SharedParameter(name, known[0][0], values, deviations))
    both = {each.name for each in shared}
    rest = (tuple(p for p in each if p not in both) for each in own)
    return tuple(shared), {name: left for name, left in zip(names, rest, strict=True) if left}


def _torques(estimates: Sequence[Estimate], names: Sequence[str], seed: int) -> tuple[TorqueGap | None, str]:
    """Return the torques on common states; None and the reason where that cannot be."""
    joints = estimates[0].model.robot.joint_names
    unknown = [name for name, each in zip(names, estimates, strict=True) if each.envelope is None]
    if unknown:
        return None, f"{', '.join(unknown)}: the file does not state its training range; identify again"
    seen = [each.envelope for each in estimates if each.envelope is not None]
    low = np.max([each.low[:3] for each in seen], axis=0)
    high = np.min([each.high[:3] for each in seen], axis=0)
    if np.any(high < low):
        quantity, joint = np.unravel_index(int(np.argmin(high - low)), low.shape)
        return None, f"their logs have no {_QUANTITIES[quantity]} of {joints[joint]} in common"
    q, dq, ddq = np.moveaxis(np.random.default_rng(seed).uniform(low, high, (STATES, *low.shape)), 1, 0)
    states = Log(joints, np.arange(float(STATES)), q, dq, ddq)
    try:
        found = [RegressorStream(each.model, each.base).predict(states, each.beta) for each in estimates]
    except DynidentError as error:  # friction that asks for temperatures
        return None, str(error)
    sizes = np.sqrt([np.mean(torque**2, axis=0) for torque in found])
    gaps = np.sqrt([np.mean((torque - found[0]) ** 2, axis=0) for torque in found])
    return TorqueGap(sizes, gaps), ""
