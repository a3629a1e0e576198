"""Methods of values that stand on verbs of higher wings: each verb is looked up by name when it is first called.

An estimate can so be printed, plotted, saved and exported without an import from a lower wing to a higher one. The
text of a value in an interactive session is here too: one line, whatever the value holds.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from dynident.errors import BadOption


def verb(place: str, name: str) -> Any:
    """Return a function of the package by its module below ``dynident`` and its name."""
    return getattr(import_module(f"dynident.{place}"), name)


def check_held(joints: Iterable[Any], positions: Mapping[str, float]) -> None:
    """Refuse a position of a joint that is beyond its limits by more than their distance: degrees or mm, not rad or m.

    Args:
        joints: The joints.
        positions: Where some are locked, by name, in rad or m.

    Raises:
        BadOption: There is one; 0 passes, which may mean that the position is not known.
    """
    for joint in joints:
        at, low, high = positions.get(joint.name, 0.0), joint.limits.lower, joint.limits.upper
        if at and not 2 * low - high <= at <= 2 * high - low:
            unit, other = ("rad", "degrees") if joint.kind == "revolute" else ("m", "mm")
            step = f"give {unit}, not {other}; the limits of '{joint.name}' are {low:.4g} to {high:.4g} {unit}"
            raise BadOption("locked", {joint.name: at}, step)


class EstimateMethods:
    """What an estimate can do besides hold values: text, tables, plots, torques, files."""

    def __repr__(self) -> str:
        own: Any = self
        error, verdict = own.train.total_relative_error, verb("diagnosis.verdict", "verdict_of")(self)
        state = "NOT ACCEPTED, " if verdict.causes else ""
        state += "consistent" if own.consistency.consistent else "physically inconsistent"
        count, estimator = own.base.count, own.estimator
        name = own.model.robot.name
        return f"<Estimate of {name}: {count} base parameters by {estimator}, {state}, training error {error:.2%}>"

    def _repr_html_(self) -> str:
        return verb("results.estimate_summary", "summary_html")(self)

    def summary(self, test: Any = None) -> str:
        """Return the estimate as text: data, figures of fit by joint, and each base parameter with t, p and interval.

        Args:
            test: A :class:`Validation` on data that had no part in the fit, whose figures stand beside.
        """
        return verb("results.estimate_summary", "summary_text")(self, test)

    def to_frame(self) -> Any:
        """Return the base parameters as a pandas frame: value, std, t, p, interval of 95 % and unit, by name.

        Raises:
            MissingDependency: pandas is not installed (extra ``pandas``).
        """
        return verb("results.estimate_summary", "to_frame")(self)

    def predict(self, q: Any, dq: Any = None, ddq: Any = None, temperature: Any = None) -> Any:
        """Return the torque of the identified model, bodies, rotors and friction, shape (n,) or (N, n), in N m or N.

        Friction that remembers (presliding) counts as slipped the way of the motion: samples need not follow each
        other. :func:`validate` and ``dynident predict`` carry it along a log.

        Args:
            q: Positions, shape (n,) or (N, n), in rad or m.
            dq: Velocities of the same shape; None for a robot at rest.
            ddq: Accelerations of the same shape; None for zero.
            temperature: Of the drives, in degrees Celsius, where friction depends on it.

        Raises:
            BadArgument: A shape that does not fit, a value that is not finite, or positions in degrees.
        """
        return verb("applications.compensation", "feed_forward")(_of(self).model, _theta(self), q, dq, ddq, temperature)

    def mass_matrix(self, q: Any) -> Any:
        """Return the identified mass matrix with rotors at positions q, shape (n, n) or (N, n, n)."""
        return _of(self).model.mass_matrix(q, _theta(self))

    def gravity(self, q: Any) -> Any:
        """Return the identified gravity torque at positions q, shape (n,) or (N, n), in N m or N.

        It is that of the bodies, as in exported models; offsets of the friction (``F0``) are not in it.
        """
        return _of(self).model.gravity(q, _theta(self))

    def plot_torques(self, validation: Any = None, joints: Any = None) -> Any:
        """Return a matplotlib figure of measured and predicted torque with the residual and its 95 % band.

        Args:
            validation: Test data (:func:`validate`); None for the data of the fit.
            joints: Names of the joints; None for all.

        Raises:
            MissingDependency: matplotlib is not installed (extra ``plot``).
            BadArgument: A joint that the robot does not have, or an estimate without samples (from QR factors).
        """
        return verb("results.plots", "plot_torques")(self, validation, joints)

    def plot_parameters(self) -> Any:
        """Return a matplotlib figure of the base parameters: value with its 95 % interval, nominal value beside.

        Raises:
            MissingDependency: matplotlib is not installed (extra ``plot``).
        """
        return verb("results.plots", "plot_parameters")(self)

    def plot_friction(self, joints: Any = None) -> Any:
        """Return a matplotlib figure of the friction of each joint over speed, model and measurement.

        Args:
            joints: Names of the joints; None for all.

        Raises:
            MissingDependency: matplotlib is not installed (extra ``plot``).
            BadArgument: A joint that the robot does not have, or a model without friction.
        """
        return verb("results.plots", "plot_friction")(self, joints)

    def save(self, path: Any) -> None:
        """Write the estimate as JSON; :meth:`load` reads it.

        Raises:
            FileError: The file cannot be written.
        """
        verb("api.estimate_output", "write_estimate")(self, path)

    @classmethod
    def load(cls, path: Any) -> Any:
        """Return the estimate in a file.

        Raises:
            FileError: The file cannot be read.
            EstimateFormatError: It is no estimate, or damaged.
        """
        return verb("identification.files.estimate_file", "read_estimate")(path)

    def export(self, exporter: str, path: Any, description: Any = None) -> Any:
        """Write the model for another program, and prove the file by loading it again; see :func:`export`.

        Args:
            exporter: Such as ``urdf``, ``mjcf`` or ``c_header``; ``dynident list models`` shows all.
            path: The file to write.
            description: Robot model to put the values into; None for that of the identification.

        Raises:
            DynidentError: As :func:`export`.
        """
        return verb("api.export", "export")(self, exporter, path, description=description)


class ModelMethods:
    """Torques and matrices of a dynamic model at states given as arrays."""

    def __repr__(self) -> str:
        own: Any = self
        parts = ", ".join(type(part).__module__.rsplit(".", 1)[-1] for part in own.friction) or "no friction"
        return f"<DynamicModel of {own.robot.name}: {own.robot.dof} joints, {parts}>"

    def at_states(self, values: Any, q: Any, dq: Any, ddq: Any) -> Any:
        """Return what a function makes of states given as arrays: of one state (n,) without the axis of samples.

        Args:
            values: Takes a motion, returns an array (N, ...).
            q: Positions, shape (n,) or (N, n).
            dq: Velocities of the same shape; None for zero.
            ddq: Accelerations of the same shape; None for zero.

        Raises:
            BadArgument: A shape that does not fit, a value that is not finite, or positions in degrees.
        """
        motion, is_one = verb("applications.states", "motion_of_arrays")(_of(self).robot, q, dq, ddq)
        return values(motion)[0 if is_one else slice(None)]

    def theta_or_nominal(self, theta: Any) -> Any:
        """Return standard parameters, shape (p,): those given, or of the robot model where none are.

        Raises:
            BadArgument: A wrong number of them, or a robot model without inertias.
        """
        return verb("applications.states", "theta_or_nominal")(self, theta)

    def mass_matrix(self, q: Any, theta: Any = None) -> Any:
        """Return the mass matrix with rotors, shape (n, n) or (N, n, n).

        Args:
            q: Positions, shape (n,) or (N, n), in rad or m.
            theta: Standard parameters, shape (p,); None for those of the robot model.

        Raises:
            BadArgument: A shape that does not fit, or a robot model without inertias.
        """
        own = _of(self)
        return verb("applications.compensation", "mass_matrices")(own, own.theta_or_nominal(theta), q)

    def gravity(self, q: Any, theta: Any = None) -> Any:
        """Return the torque that holds the arm, without friction, shape (n,) or (N, n), in N m or N.

        Args:
            q: Positions, shape (n,) or (N, n), in rad or m.
            theta: Standard parameters, shape (p,); None for those of the robot model.

        Raises:
            BadArgument: A shape that does not fit, or a robot model without inertias.
        """
        own = _of(self)
        return verb("applications.compensation", "gravity_torque")(own, own.theta_or_nominal(theta), q)


class ShortText:
    """One line in place of all values of a robot, a log or a validation."""

    def __repr__(self) -> str:
        own: Any = self
        kind = type(self).__name__
        if kind == "Log":
            signals = ", ".join(own.signals())
            return f"<Log of {len(own.joints)} joints: {own.samples} samples, {own.duration:.4g} s; {signals}>"
        if kind == "Validation":
            return f"<Validation: relative error {own.total_relative_error:.2%}, {own.samples} samples>"
        return f"<{kind} {own.name}: {own.dof} joints, {len(own.links)} links>"


def _of(value: object) -> Any:
    return value


def _theta(estimate: object) -> Any:
    return verb("applications.compensation", "parameters_of")(estimate)
