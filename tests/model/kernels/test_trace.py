"""The tracer: what a traced formula computes is what the formula computes, with as few operations as it can see."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynident.model.kernels.numpy_source import numpy_function
from dynident.model.kernels.trace import (
    Number,
    Scalar,
    Trace,
    cosine,
    exponential,
    gradient,
    is_zero,
    larger,
    power,
    sign,
    sine,
    smaller,
    smooth_sign,
    tangent_hyperbolic,
)

numbers = st.one_of(st.sampled_from([0.0, 1.0, -1.0, 0.5]), st.floats(-3, 3))
leaves = st.one_of(numbers, st.sampled_from(["x", "y", "z"]))
trees = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(["+", "-", "*"]), inner, inner),
        st.tuples(st.sampled_from(["neg", "sin", "cos"]), inner),
    ),
    max_leaves=12,
)


def build(tree: Any, values: dict[str, Any]) -> Any:
    """Return the value of a random formula over floats or traced scalars."""
    if not isinstance(tree, tuple):
        return values.get(tree, tree)
    operands = [build(part, values) for part in tree[1:]]
    match tree[0]:
        case "+":
            return operands[0] + operands[1]
        case "-":
            return operands[0] - operands[1]
        case "*":
            return operands[0] * operands[1]
        case "neg":
            return -operands[0]
        case name:
            return {"sin": sine, "cos": cosine}[name](operands[0])


def inputs(trace: Trace) -> dict[str, Scalar]:
    return {name: trace.input("v", k) for k, name in enumerate("xyz")}


def run(trace: Trace, value: Number, point: list[float]) -> float:
    found = trace.program({0: value}).evaluate({"v": np.array(point)})
    return float(found.get(0, np.float64(0.0)))


def number(value: Number) -> int:
    assert isinstance(value, Scalar)
    return value.number


@given(trees, st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_a_program_computes_its_formula(tree: Any, point: list[float]) -> None:
    trace = Trace()
    expected = build(tree, dict(zip("xyz", point, strict=True)))
    found = run(trace, build(tree, inputs(trace)), point)
    assert math.isclose(found, expected, rel_tol=1e-9, abs_tol=1e-9)


@given(trees, st.lists(st.floats(-1, 1), min_size=3, max_size=3))
@settings(max_examples=50)
def test_the_gradient_is_the_slope_of_the_formula(tree: Any, point: list[float]) -> None:
    trace, step = Trace(), 1e-6
    known = inputs(trace)
    value = build(tree, known)
    slopes = gradient(trace, {0: value}, {0: trace.constant(1.0)}, known.values())
    size = 1.0 + abs(run(trace, value, point))
    for k, slope in enumerate(slopes):
        ends = [run(trace, value, [x + sign * step * (i == k) for i, x in enumerate(point)]) for sign in (1, -1)]
        assert abs(run(trace, slope, point) - (ends[0] - ends[1]) / (2 * step)) < 1e-3 * size


def test_zeros_ones_and_signs_vanish() -> None:
    trace = Trace()
    x, y = trace.input("v", 0), trace.input("v", 1)
    assert is_zero(0.0 * x)
    assert is_zero(x - x)
    for same in (1.0 * x, x + 0.0, 0.0 + x, x - 0.0, -1.0 * -x):
        assert number(same) == x.number
    assert number(x + -y) == number(x - y) == number(-1.0 * (y - x))
    assert number((-x) * (-y)) == number(x * y)
    assert trace.program({0: -2.0 * x, 1: 2.0 * x}).operations == 2  # one product, one sign


def test_equal_operations_are_one_node() -> None:
    trace = Trace()
    x, y = trace.input("v", 0), trace.input("v", 1)
    assert number(x * y) == number(y * x)
    assert number(x + y) == number(y + x)
    program = trace.program({0: x * y + 1.0, 1: (y * x) * (x * y)})
    assert program.operations == 3


def test_a_program_keeps_only_what_its_outputs_need() -> None:
    trace = Trace()
    x = trace.input("v", 0)
    sine(x * x)
    program = trace.program({4: x + 2.0, 5: 0.0, 7: 3.0})
    assert program.operations == 1
    assert program.arrays == ("v",)
    assert sorted(program.outputs) == [4, 7]
    found = program.evaluate({"v": np.array([[1.0, 2.0]])})
    assert found[4].tolist() == [3.0, 4.0]
    assert float(found[7]) == 3.0


def test_a_gradient_takes_the_weights_of_all_outputs() -> None:
    trace = Trace()
    x, y = trace.input("v", 0), trace.input("v", 1)
    outputs: dict[int, Number] = {0: x * x, 1: x * y, 2: x * x, 3: 5.0}
    weights = {slot: trace.input("w", slot) for slot in outputs}
    slopes = gradient(trace, outputs, weights, [x, y])
    values = {"v": np.array([2.0, 3.0]), "w": np.array([1.0, 10.0, 100.0, 1000.0])}
    found = trace.program(dict(enumerate(slopes))).evaluate(values)
    assert float(found[0]) == pytest.approx(2 * 2 * 101 + 3 * 10)
    assert float(found[1]) == pytest.approx(2 * 10)


def test_outputs_that_are_rounding_alone_are_found() -> None:
    trace = Trace()
    x, y = trace.input("v", 0), trace.input("v", 1)
    c, s = cosine(x), sine(x)
    program = trace.program(
        {0: (c + y) * s - c * s - y * s, 1: c * c + s * s - 1.0, 2: 1e-9 * x * y, 3: c + 1e-12 * y - c, 4: x - y}
    )
    states = {"v": np.random.default_rng(0).normal(size=(2, 12))}
    assert program.rounding_only(states) == {0, 1}


FORMULAS = {
    "exp": (lambda x, y: exponential(-x * y), lambda x, y: np.exp(-x * y)),
    "tanh": (lambda x, y: tangent_hyperbolic(x + y), lambda x, y: np.tanh(x + y)),
    "turn": (lambda x, y: y * smooth_sign(x, 0.3), lambda x, y: y * np.tanh(x / 0.3)),
    "sharp": (lambda x, y: y * smooth_sign(x, 0.0) + sign(y), lambda x, y: y * np.sign(x) + np.sign(y)),
    "abs": (lambda x, y: abs(x) * y, lambda x, y: np.abs(x) * y),
    "max": (lambda x, y: larger(x, y) * x, lambda x, y: np.maximum(x, y) * x),
    "min": (lambda x, y: smaller(x, 0.2) * y, lambda x, y: np.minimum(x, 0.2) * y),
    "div": (lambda x, y: -x / y + 2.0 / (y * y), lambda x, y: -x / y + 2.0 / y**2),
    "pow": (lambda x, y: (x**2 + 0.1) ** -0.3 + y**3, lambda x, y: (x**2 + 0.1) ** -0.3 + y**3),
    "root": (lambda x, y: power(abs(x), 0.5) * y, lambda x, y: np.sqrt(np.abs(x)) * y),
    "steep": (lambda x, y: power(abs(x), 1.7) * y, lambda x, y: np.abs(x) ** 1.7 * y),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_functions_that_friction_needs_and_their_derivatives(name: str) -> None:
    """Values beside NumPy's own, by both ways to run a program; derivatives beside central differences."""
    traced, plain = FORMULAS[name]
    trace = Trace()
    scalars = [trace.input("x", 0), trace.input("y", 0)]
    value = traced(*scalars)
    x, y = np.random.default_rng(0).uniform(0.1, 1.5, (2, 200)) * np.random.default_rng(1).choice([-1.0, 1.0], (2, 200))
    arrays = {"x": x[None], "y": y[None]}
    program = trace.program({0: value})
    np.testing.assert_allclose(program.evaluate(arrays)[0], plain(x, y), rtol=1e-13)
    np.testing.assert_array_equal(numpy_function(program)(arrays)[0], program.evaluate(arrays)[0])
    slopes = trace.program(dict(enumerate(gradient(trace, {0: value}, {0: 1.0}, scalars))))
    found, step = slopes.evaluate(arrays), 1e-6
    for slot, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        difference = (plain(x + dx, y + dy) - plain(x - dx, y - dy)) / (2 * step)
        np.testing.assert_allclose(np.broadcast_to(found.get(slot, 0.0), 200), difference, rtol=1e-6, atol=1e-7)


def test_constants_are_folded_and_slopes_at_zero_are_finite() -> None:
    assert smooth_sign(0.3, 0.1) == pytest.approx(np.tanh(3.0)) and smooth_sign(-0.3, 0.0) == -1.0
    assert larger(1.0, 2.0) == 2.0 and smaller(1.0, 2.0) == 1.0 and power(4.0, 0.5) == 2.0
    trace = Trace()
    x = trace.input("x", 0)
    (slope,) = gradient(trace, {0: power(abs(x), 0.5) * smooth_sign(x, 0.1)}, {0: 1.0}, [x])
    assert trace.program({0: slope}).evaluate({"x": np.zeros((1, 1))})[0] == 0.0
