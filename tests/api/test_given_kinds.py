"""Arguments of another kind than is wanted: each message has the line that works."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import dynident as di
from dynident.errors import BadOption, DynidentError
from dynident.model.robot import Robot

pd = pytest.importorskip("pandas")

TIME = np.arange(40) / 100.0
Q = np.column_stack([0.3 * np.sin(3 * TIME), 0.2 * np.cos(2 * TIME)])

TEXT: Any = "x.urdf"
LIMITS: Any = {"velocity": 1}
PAIR: Any = ("coulomb", {"width": 0.1})
MAPPING: Any = {"coulomb": {"width": 0.1}}


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda arm: di.DynamicModel(TEXT, ["coulomb"]), "robot: the text 'x.urdf' where a Robot is wanted"),
        (di.base_parameters, "model: a Robot where a DynamicModel is wanted; write di.base_parameters"),
        (lambda arm: di.limits_of(TEXT), "where a Robot is wanted; write di.limits_of"),
        (di.design_excitation, "model: a Robot where a DynamicModel is wanted"),
        (lambda arm: di.excite(arm, limits=LIMITS), "limits: a dict where a MotionLimits is wanted"),
        (lambda arm: di.DynamicModel(arm, [PAIR]), r"FRICTION.make\('coulomb', {'width': 0.02}\)"),
        (lambda arm: di.DynamicModel(arm, [MAPPING]), r"FRICTION.make\('coulomb', {'width': 0.02}\)"),
        (lambda arm: di.log_of({"time": 250, "q": Q}, arm), r"the number 250 .*np.arange\(len\(q\)\) / 250$"),
    ],
)
def test_another_kind_is_refused_with_the_line_that_works(
    planar_2r: Robot, call: Callable[[Robot], Any], told: str
) -> None:
    with pytest.raises(BadOption, match=told):
        call(planar_2r)


@pytest.mark.parametrize("at", [90.0, -250.0])
def test_a_joint_locked_in_degrees_is_refused(at: float) -> None:
    robot = di.read_robot("er16")
    joint = robot.active[1]
    with pytest.raises(BadOption, match=f"give rad, not degrees; the limits of '{joint.name}' are .* rad"):
        robot.locked({joint.name: at})
    near = joint.limits.upper + 0.1  # a model may state less than the hardware has
    assert robot.locked({joint.name: near}).dof == robot.dof - 1


@pytest.mark.parametrize("form", ["{}", "q_{}"])
def test_columns_with_names_of_joints_are_taken_in_their_order(planar_2r: Robot, form: str) -> None:
    names = [form.format(name) for name in planar_2r.joint_names]
    frame = pd.DataFrame(Q, columns=names)
    turned = frame[names[::-1]].assign(other=1.0)
    for values in (frame, turned):
        np.testing.assert_array_equal(di.log_of({"time": TIME, "q": values}, planar_2r).q, Q)
    plain = pd.DataFrame(Q[:, ::-1], columns=["a", "b"])
    np.testing.assert_array_equal(di.log_of({"time": TIME, "q": plain}, planar_2r).q, Q[:, ::-1])


def test_columns_of_which_some_are_joints_are_refused(planar_2r: Robot) -> None:
    first, second = planar_2r.joint_names
    frame = pd.DataFrame(Q, columns=["other", first])
    with pytest.raises(
        BadOption, match=f"of which {first} are joints; name the columns of all joints: {first}, {second}"
    ):
        di.log_of({"time": TIME, "q": frame}, planar_2r)


def test_the_message_of_a_tensor_is_kept(planar_2r: Robot) -> None:
    class Tensor:
        shape, ndim = Q.shape, 2

        def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
            raise TypeError("use Tensor.cpu() first")

    with pytest.raises(
        BadOption, match=r"q: Tensor that is no array of numbers; its own message: use Tensor.cpu\(\) first"
    ):
        di.log_of({"time": TIME, "q": Tensor()}, planar_2r)
    with pytest.raises(BadOption, match="give rows of equal length"):
        di.log_of({"time": TIME, "q": [[1.0, 2.0], [3.0]]}, planar_2r)


def test_columns_of_a_frame_may_be_counted_from_zero(planar_2r: Robot) -> None:
    torque = np.ones_like(Q)
    frame = pd.DataFrame(np.column_stack([TIME, Q, torque]), columns=["t", "q0", "q1", "tau0", "tau1"])
    log = di.log_of(frame, planar_2r)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.torque, torque)
    with pytest.raises(BadOption, match="none is 'q1'"):
        di.log_of(frame.drop(columns="q1"), planar_2r)


@pytest.mark.parametrize(("unit", "scale"), [("ms", 1e3), ("us", 1e6)])
def test_arrays_in_another_unit_of_time_get_the_line_of_numpy(planar_2r: Robot, unit: str, scale: float) -> None:
    log = {"time": TIME * scale, "q": Q, "torque": np.sin(5 * Q)}
    with pytest.raises(DynidentError, match=rf"write time = time \* {1 / scale:g} if it is in {unit}, 100 samples"):
        di.identify(planar_2r, log)
