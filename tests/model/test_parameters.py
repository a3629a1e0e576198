"""Names and units of parameters; the orders of Pinocchio and MuJoCo against the libraries themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dynident.arrays import Array
from dynident.model.base_parameters import base_parameters
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction.base import Coefficient, Friction, Inputs, Number
from dynident.model.inertia import TEN, Inertia
from dynident.model.parameters import (
    TEN_UNITS,
    Parameter,
    from_pinocchio,
    inertial_parameters,
    to_mujoco_fullinertia,
    to_pinocchio,
)
from dynident.model.robot import Robot

THETA = arrays(float, (3, 10), elements=st.floats(-10, 10))


def test_name_and_unit() -> None:
    parameter = Parameter("Izz", "link1", "kg m^2")
    assert parameter.name == "Izz[link1]"
    assert not parameter.nonnegative


def test_ten_for_each_link_in_order(planar_2r: Robot) -> None:
    found = inertial_parameters(planar_2r)
    assert [p.name for p in found] == [f"{symbol}[{link}]" for link in ("link1", "link2") for symbol in TEN]
    assert [p.unit for p in found] == list(TEN_UNITS) * 2
    assert TEN_UNITS == ("kg m^2",) * 6 + ("kg m",) * 3 + ("kg",)


@given(THETA)
def test_pinocchio_order_is_a_bijection_over_any_shape(theta: Array) -> None:
    np.testing.assert_array_equal(from_pinocchio(to_pinocchio(theta)), theta)
    np.testing.assert_array_equal(to_pinocchio(from_pinocchio(theta)), theta)
    np.testing.assert_array_equal(to_pinocchio(theta)[1], to_pinocchio(theta[1]))


def test_mujoco_reads_the_order() -> None:
    """A free body: the inertia that MuJoCo's mass matrix shows about each axis of the body at its centre of mass."""
    mujoco = pytest.importorskip("mujoco")
    body = Inertia.from_centre_of_mass(2.0, np.zeros(3), [[0.3, 0.02, -0.01], [0.02, 0.4, 0.03], [-0.01, 0.03, 0.5]])
    six = " ".join(repr(float(x)) for x in to_mujoco_fullinertia(body.vector))
    xml = f"""<mujoco><worldbody><body><freejoint/>
        <inertial pos="0 0 0" mass="{body.mass}" fullinertia="{six}"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.array([_turned(mujoco, model, data, axis) for axis in np.eye(3)])
    np.testing.assert_allclose(inertia, body.rotational, atol=1e-10)


def _turned(mujoco: object, model: object, data: object, axis: Array) -> Array:
    """Return M times a unit angular acceleration about ``axis``: the column of the inertia."""
    result = np.zeros(6)
    mujoco.mj_mulM(model, data, result, np.r_[np.zeros(3), axis])  # type: ignore[attr-defined]
    return result[3:]


@dataclass(frozen=True)
class KilogramsPerSecond(Friction):
    """Viscous friction in kg/s, which is N s/m: friction by its expression, whatever its unit begins with."""

    coefficients: ClassVar = (Coefficient("Fk", "kg m^2/s", "kg/s", nonnegative=True),)

    def terms(self, at: Inputs) -> tuple[Number, ...]:
        return (at.dq,)


def test_kind_comes_from_the_expression_not_from_the_unit(scara: Robot) -> None:
    model = DynamicModel(scara, (KilogramsPerSecond(), "rotor_inertia"))
    kinds = {(p.symbol in TEN, p.symbol, p.kind) for p in model.parameters if p.symbol in ("m", "Fk", "Ia")}
    assert kinds == {(True, "m", "body"), (False, "Fk", "friction"), (False, "Ia", "rotor")}
    base = base_parameters(model)
    kept = [base.parameters[k].kind == "friction" for k in base.independent]
    assert base.is_friction.tolist() == kept and sum(kept) == scara.dof
