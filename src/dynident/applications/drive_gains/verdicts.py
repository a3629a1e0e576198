"""Whether logs determine a drive gain, and where they do not, why not and what to do."""

from __future__ import annotations

import numpy as np

from dynident.applications.drive_gains.drive_gains import IDENTIFIED, NOT_DETERMINED, REVERSED, DriveGain
from dynident.applications.drive_gains.gain_data import GainData, group_squares
from dynident.applications.drive_gains.intervals import GainSpread
from dynident.applications.drive_gains.methods import GainFit
from dynident.arrays import Array
from dynident.identification.problem.regressor_stream import motion_of
from dynident.model.friction import Motion

#: Half an interval over the gain above which a gain counts as not determined.
LOOSE = 0.2

#: Share of what the known bodies ask of a drive below which gravity has no part in it.
STILL = 0.02

#: Postures at which gravity is looked at, in each run.
POSTURES = 200


def judged(data: GainData, fit: GainFit, spread: GainSpread, scale: str, current_unit: str) -> tuple[DriveGain, ...]:
    """Return the gains with their labels and reasons.

    Args:
        data: Reduced rows.
        fit: What a method found.
        spread: Their intervals.
        scale: What sets the scale: ``"payload"`` or ``"bodies"``.
        current_unit: Unit of the currents.
    """
    counts = np.maximum(data.counts, 1.0)
    residual = np.sqrt(group_squares(data, fit.rows) / counts)
    if not fit.rows.inverse:
        residual = residual / np.maximum(np.abs(fit.gains), 1e-100)
    driven, still = _driven(data, fit), _still(data, fit)
    current = np.sqrt(data.current_squares / counts)
    units = {joint.name: joint.unit for joint in data.rows[0].problem.model.robot.active}
    found = []
    sizes = np.maximum(np.abs(fit.gains), 1e-100)
    for g, group in enumerate(data.groups):
        half = 0.5 * (spread.high[g] - spread.low[g]) / sizes[g]
        asked = float(driven[g] / sizes[g])
        label, reason = IDENTIFIED, ""
        if spread.open[g] or not half <= LOOSE:
            evidence = "no row tells it from the rest" if spread.open[g] else _width(half)
            evidence += f"; the {scale} ask{'s' if scale == 'payload' else ''} {asked:.2g} {current_unit} of it"
            evidence += f", the fit leaves {residual[g]:.2g} {current_unit}"
            label, reason = NOT_DETERMINED, f"{evidence}; {_step(still[g] < STILL * driven[g], scale)}"
        elif fit.gains[g] < 0:
            label = REVERSED
            reason = (
                "its current counts against the motion of the joint; right where the drive is wired so, else turn "
                "the sign of the column or of the axis"
            )
        value, low, high = (float(each[g]) for each in (fit.gains, spread.low, spread.high))
        told = (float(spread.deviations[g]), label, reason, asked, float(residual[g]), float(current[g]))
        found.append(
            DriveGain(group.joint, group.sign, value, low, high, *told, f"{units[group.joint]}/{current_unit}")
        )
    return tuple(found)


def share_remark(gains: tuple[DriveGain, ...], spread: GainSpread, share: float) -> tuple[str, ...]:
    """Return the share of the bodies that would determine gains, where it is the share that leaves them open."""
    factors = spread.share_for(LOOSE * (1.0 - LOOSE**2))  # a half interval h of 1 / K is one of h / (1 - h^2) of K
    wide = {g.name: share * f for g, f in zip(gains, factors.tolist(), strict=True) if not g.known and f < 1.0}
    if not wide:
        return ()
    digit = 10.0 ** np.floor(np.log10(min(wide.values())))
    enough = digit * np.floor(min(wide.values()) / digit)  # rounded down: to first order alone
    return (
        f"bodies trusted within {100 * share:g} % leave intervals of more than {100 * LOOSE:.0f} % to either side "
        f"({', '.join(wide)}): --prior-share {enough:.1g} determines them; state it only where the robot model is that "
        "good, else use a known payload (--load)",
    )


def _width(half: float) -> str:
    if not np.isfinite(half):
        return "its interval has no end"
    return f"its interval is {100 * half:.0f} % to either side"


def _step(without_gravity: bool, scale: str) -> str:
    if scale == "bodies":
        return "use two runs with and without a known payload, or log a motion in which this drive works harder"
    if without_gravity:
        return (
            "gravity on the payload does not act about this axis: accelerate it more with the payload far out, state "
            "the payload's centre and inertia, fix the payload off this axis, or mount the arm tilted"
        )
    return "take a heavier payload, further out, and turn this joint through its range in both runs"


def _driven(data: GainData, fit: GainFit) -> Array:
    """Return the root mean square torque that the bodies that set the scale ask of each group, shape (G,)."""
    squares, counts = np.zeros(len(data.groups)), np.zeros(len(data.groups))
    for run, triangles in enumerate(data.triangles):
        body = np.append(data.unknowns.scale_bodies(run, fit.z), [0.0, 0.0])
        if not np.any(body):
            continue
        for g, triangle in enumerate(triangles):
            squares[g] += np.sum((triangle.factor[:, :-1] @ body[triangle.columns]) ** 2)
            counts[g] += triangle.rows
    return np.sqrt(squares / np.maximum(counts, 1.0))


def _still(data: GainData, fit: GainFit) -> Array:
    """Return the root mean square of the same at rest, of gravity alone and about its mean sign, shape (G,)."""
    squares, count = np.zeros(len(data.groups)), 0
    for run, rows in enumerate(data.rows):
        body = data.unknowns.scale_bodies(run, fit.z)
        if not np.any(body):
            continue
        model, base = rows.problem.model, rows.problem.base
        turn = np.linalg.inv(np.asarray(model.robot.coupling))
        for log in rows.problem.logs:
            q = motion_of(log.log).q[log.keep[:: max(1, len(log.keep) // POSTURES)]]
            none = np.zeros_like(q)
            columns = model.regressor(Motion(q, none, none, torque=none, temperature=none))[..., base.independent]
            torque = (columns @ body[: base.count]) @ turn
            squares += np.sum(torque[:, [group.drive for group in data.groups]] ** 2, axis=0)
            count += len(q)
    return np.sqrt(squares / max(count, 1))
