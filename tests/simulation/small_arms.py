"""Small virtual arms, a motion of theirs, and parameters of virtual robots."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynident.excitation.trajectories.fourier import FourierSeries
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, Joint, Mimic
from dynident.model.robot import Link, Robot


def body(mass, centre, moments):
    return Inertia.from_centre_of_mass(mass, centre, np.diag(moments))


def two_link_arm(**drive):
    """Return two links that swing about y, the second coupled to both motors if a coupling is given."""
    links = (
        Link("upper", body(4, [0.2, 0, 0.01], [0.02, 0.06, 0.06])),
        Link("lower", body(2, [0.15, 0.02, 0], [0.01, 0.03, 0.03])),
    )
    y = np.array([0.0, 1.0, 0.0])
    joints = (
        Joint("shoulder", "revolute", -1, np.eye(3), np.zeros(3), y, drive=Drive(100.0, 1e-5)),
        Joint("elbow", "revolute", 0, np.eye(3), np.array([0.4, 0, 0]), y, drive=Drive(50.0, 1e-5)),
    )
    return Robot("two-link", links, joints, **drive)


def mimic_arm():
    """Return an arm whose third link follows the second joint at -0.5 times its angle."""
    base = two_link_arm()
    follower = Joint(
        "wrist",
        "revolute",
        1,
        np.eye(3),
        np.array([0.3, 0, 0]),
        np.array([0.0, 1.0, 0.0]),
        mimic=Mimic("elbow", -0.5, 0.1),
    )
    return replace(
        base,
        links=(*base.links, Link("hand", body(1, [0.1, 0, 0], [0.01, 0.01, 0.01]))),
        joints=(*base.joints, follower),
    )


def wave(joints, seed=0, size=0.2, period=5.0):
    sine, cosine = size * np.random.default_rng(seed).normal(size=(2, joints, 3))
    return FourierSeries(np.linspace(-0.3, 0.4, joints), sine, cosine, period)


def with_friction(model, values):
    """Return theta with the same friction coefficients at every joint."""
    nominal = model.robot.nominal
    assert nominal is not None
    return np.concatenate([nominal, np.tile(values, model.robot.dof)])
