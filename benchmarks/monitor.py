"""Does a collision monitor raise false alarms at the chosen rate, and how fast does it see a contact?

A six-joint arm with Coulomb and viscous friction and an offset is identified from 30 s of noisy motion at 500 Hz (white
noise of the velocities, torque noise of first order with 0.9 from sample to sample). Clean runs of 300 s set the
thresholds; other motions of 600 s count the false alarms at several rates (``expected``: the rate times the time,
``joints``: alarms of each joint). A contact of five thresholds at one joint, constant from its start on, comes at 200
moments of each joint; the motion goes on as planned and the drive takes the contact. Printed: false alarms, largest and
median delay until the alarm, and the processor time of one step of a stream (median).
Run: python -m benchmarks.monitor [seconds of the clean test runs]
"""

from __future__ import annotations

import json
import sys
import time as clock

import numpy as np
import scipy.signal

from benchmarks.loaded_arm import six_joint_arm
from dynident import FourierSeries, Log, identify
from dynident.applications.monitor import MomentumObserver, MonitorState, calibrated, run_monitor, step
from dynident.applications.monitor.signals import residuals_of, signals_of
from dynident.model.friction import Motion

RATE, MEMORY, SPEED_NOISE = 500.0, 0.9, 1e-3
TORQUE_NOISE = np.array([3.0, 3.0, 2.0, 0.5, 0.5, 0.3])
RATES = (60.0, 180.0, 360.0)
CONTACTS = 200


class Cell:
    """An arm whose truth is known and its noisy logs."""

    def __init__(self):
        self.model, friction = six_joint_arm()
        self.theta = np.concatenate([self.model.robot.nominal, friction])

    def log(self, seconds, seed):
        """Return a run of several random motions of 10 s one after the other, each a whole number of periods."""
        generator, joints = np.random.default_rng(seed), self.model.robot.dof
        time = np.arange(int(seconds * RATE)) / RATE
        sine, cosine = 0.3 * generator.normal(size=(2, joints, 5))
        series = FourierSeries(np.zeros(joints), sine, cosine, 30.0)
        q, dq, ddq = series.evaluate(3.0 * time)
        dq, ddq = 3.0 * dq, 9.0 * ddq
        torque = self.model.torque(Motion(q, dq, ddq), self.theta)
        white = generator.normal(size=torque.shape)
        noise = scipy.signal.lfilter([np.sqrt(1 - MEMORY**2)], [1, -MEMORY], white, axis=0)
        speed = dq + SPEED_NOISE * generator.normal(size=q.shape)
        return Log(self.model.robot.joint_names, time, q, speed, torque=torque + TORQUE_NOISE * noise)


def delays(monitor, log):
    """Return how long after its start each contact is seen, in s."""
    observer, generator = monitor.observer, np.random.default_rng(9)
    signals = signals_of(observer.estimate, log)
    residual = residuals_of(observer, signals)
    threshold = monitor.thresholds(signals)
    found, window = [], 100
    keep = np.exp(-observer.gain * signals.step)
    rise = 1.0 - keep ** np.arange(1, window)  # answer of the linear observer to a step between two samples
    for joint in range(residual.shape[1]):
        for start in generator.integers(1000, len(residual) - window, CONTACTS):
            size = 5.0 * threshold[start, joint] * generator.choice([-1.0, 1.0])
            inside = slice(start + 1, start + window)
            seen = np.abs(residual[inside, joint] + size * rise) > threshold[inside, joint]
            found.append((np.argmax(seen) + 1) * signals.step if seen.any() else np.inf)
    return np.array(found)


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    cell = Cell()
    estimate = identify(cell.model, [cell.log(30.0, 1)], "wls")
    observer = MomentumObserver(estimate)
    clean = [signals_of(estimate, cell.log(30.0, 100 + k)) for k in range(10)]
    tests = [cell.log(30.0, 200 + k) for k in range(max(1, round(seconds / 30.0)))]
    for rate in RATES:
        monitor = calibrated(observer, clean, rate / 3600.0)
        found = [run_monitor(monitor, log) for log in tests]
        joints = np.sum([[joint["alarms"] for joint in one.figures()["joints"]] for one in found], axis=0)
        told = {"alarms_an_hour": rate, "seconds": 30.0 * len(tests), "expected": rate * len(tests) / 120.0}
        print(json.dumps({**told, "joints": joints.tolist(), "mean": float(np.mean(joints))}), flush=True)
    monitor = calibrated(observer, clean, 1.0 / 3600.0)
    late = delays(monitor, tests[0])
    state, log, taken = MonitorState(), tests[0], []
    dq, torque = np.asarray(log.dq), np.asarray(log.torque)
    for k in range(2000):
        started = clock.process_time()
        state, _ = step(monitor, state, float(log.time[k]), log.q[k], dq[k], torque[k])
        taken.append(clock.process_time() - started)
    each = float(np.median(taken[100:]))
    seen = {
        "contacts": len(late),
        "largest_ms": round(1e3 * late.max(), 2),
        "median_ms": round(1e3 * np.median(late), 2),
    }
    print(
        json.dumps(
            {
                "alarms_an_hour": 1.0,
                **seen,
                "step_ms": round(1e3 * each, 3),
                "slowest_of_100_ms": round(1e3 * float(np.quantile(taken[100:], 0.99)), 3),
            }
        )
    )


if __name__ == "__main__":
    main()
