"""Do the 95 % intervals of drive gains hold the true gain in 95 of 100 cases? A Monte Carlo over the current noise.

A six-joint arm with Coulomb and viscous friction and an offset follows two motions of 20 s, one without and one with a
payload of 2.6 kg; friction is a fifth higher with it. The currents have noise, white or of first order with 0.9 from
sample to sample, of one twentieth of each drive's root mean square current; rows pass the default 5 Hz filter. Printed
for each kind of knowledge and each method: the share of intervals over all joints and runs that hold the true gain, the
smallest share of one joint, median relative error and median half width.
Run: python -m benchmarks.drive_gains [runs] [kind, ...]; kinds: mass centre inertia signed prior bodies
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np

from benchmarks.loaded_arm import first_order, random_motion, six_joint_arm, with_body
from dynident import DynamicModel, Inertia, Log
from dynident.applications.drive_gains import CarriedBody, GainOptions, gains_from_payload, gains_from_prior

RATE, SECONDS, SHARE, MEMORY = 200.0, 20.0, 0.05, 0.9
GAINS = np.array([14.9, 13.3, 11.1, 10.6, 8.0, 6.5])
CENTRE, BODY = np.array([0.05, 0.1, 0.04]), np.diag([0.02, 0.015, 0.012])
KINDS = ("mass", "centre", "inertia", "signed", "prior", "bodies")
TOLD = 0.05


class Bench:
    """An arm, its noise-free logs without and with the payload, and the noise of its currents."""

    def __init__(self, asymmetry: float = 0.0) -> None:
        self.model, friction = six_joint_arm()
        robot = with_body(self.model.robot, Inertia.from_centre_of_mass(2.6, CENTRE, BODY))
        heavy = DynamicModel(robot, self.model.friction)
        self.logs = tuple(
            self._log(model, np.concatenate([model.robot.nominal, friction * warm]), seed, asymmetry)
            for model, warm, seed in ((self.model, 1.0, 1), (heavy, 1.2, 2))
        )

    @staticmethod
    def _log(model, theta, seed, asymmetry):
        time = np.arange(int(SECONDS * RATE)) / RATE
        motion = random_motion(model.robot.dof, seed, time, 10.0)
        current = model.torque(motion, theta) / GAINS
        current = np.where(current < 0, current / (1.0 - asymmetry), current)
        return Log(model.robot.joint_names, time, motion.q, motion.dq, current=current)

    def noisy(self, generator, memory):
        """Return the logs with new noise."""
        found = []
        for log in self.logs:
            noise = first_order(generator, log.samples, len(GAINS), memory)
            found.append(replace(log, current=log.current + SHARE * np.sqrt(np.mean(log.current**2, axis=0)) * noise))
        return found


def _other_link(link, generator, is_other_body):
    """Return a link whose mass is off by a share, and where it is another body its centre and its inertia as well."""
    factor, *shares = 1.0 + TOLD * generator.normal(size=7)
    if not is_other_body:
        return Inertia.from_vector(factor * np.asarray(link.vector))
    size = np.sqrt(np.sum(np.asarray(link.vector)[[0, 3, 5]]) / 2.0 / link.mass)
    centre = link.centre_of_mass + size * (np.array(shares[:3]) - 1.0)
    stretch = np.diag(np.sqrt(np.abs(shares[3:])))
    return Inertia.from_centre_of_mass(factor * link.mass, centre, factor * stretch @ link.about_centre @ stretch)


def known_gains(bench, kind, generator, memory, method):
    """Return the gains of one run and the true ones."""
    without, loaded = bench.noisy(generator, memory)
    if kind in ("prior", "bodies"):  # links are lighter or heavier than the robot model says; or other ones
        links = [_other_link(link.inertia, generator, kind == "bodies") for link in bench.model.robot.links]
        theta = np.concatenate([link.vector for link in links])
        return gains_from_prior(bench.model, [without], theta, TOLD, options=GainOptions(method=method)), GAINS
    payload = {
        "mass": CarriedBody(2.6),
        "signed": CarriedBody(2.6),
        "centre": CarriedBody(2.6, CENTRE),
        "inertia": CarriedBody(2.6, CENTRE, BODY),
    }[kind]
    signed = kind == "signed"
    found = gains_from_payload(
        bench.model, [without], [loaded], payload, options=GainOptions(method=method, signed=signed)
    )
    return found, np.column_stack([GAINS, GAINS * (1 - 0.1)]).ravel() if signed else GAINS


def figures(kind, method, memory, runs):
    """Return the figures of one kind of knowledge and one method."""
    bench, generator = Bench(0.1 if kind == "signed" else 0.0), np.random.default_rng(7)
    inside, errors, halves, identified = [], [], [], []
    for _ in range(runs):
        found, true = known_gains(bench, kind, generator, memory, method)
        low, high = (np.array([getattr(gain, end) for gain in found.gains]) for end in ("low", "high"))
        inside.append((low <= true) & (true <= high))
        errors.append(np.abs([gain.value for gain in found.gains] / true - 1.0))
        halves.append(0.5 * (high - low) / true)
        identified.append([gain.known for gain in found.gains])
    return {
        "kind": kind,
        "method": method,
        "memory": memory,
        "runs": runs,
        "held": round(float(np.mean(inside)), 4),
        "smallest": round(float(np.mean(inside, axis=0).min()), 3),
        "median_error": round(float(np.median(errors)), 4),
        "largest_median_error": round(float(np.median(errors, axis=0).max()), 4),
        "median_half_width": round(float(np.median(halves)), 4),
        "identified": round(float(np.mean(identified)), 3),
    }


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for kind in sys.argv[2:] or KINDS:
        for memory in (0.0, MEMORY):
            print(json.dumps(figures(kind, "structured", memory, runs)), flush=True)
    if len(sys.argv) < 3:
        for method in ("tls", "wls", "ols"):
            print(json.dumps(figures("centre", method, MEMORY, max(runs // 4, 10))), flush=True)


if __name__ == "__main__":
    main()
