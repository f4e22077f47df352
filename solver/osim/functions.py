"""The functions in an OpenSim file."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.functions.coordinate import (
    Function,
    Sine,
    natural_spline,
    piecewise_constant,
    piecewise_linear,
    polynomial,
    scaled,
    simm_spline,
    smooth_step,
)
from solver.osim.document import Element

Array = NDArray[np.float64]


def read_function(holder: Element) -> Function:
    """The function among an element's properties: OpenSim writes properties in lower case, functions in capitals."""
    functions = [child for child in holder.children if child.tag[0].isupper()]
    if len(functions) != 1:
        raise holder.refusal(f"has {len(functions)} functions, expected one")
    return read_function_element(functions[0])


def read_named_function(holder: Element, name: str) -> Function | None:
    """The function that is the element's property of that name, if it has one.

    Its tag is the class and its name that of the property, or, in earlier files, it is within a tag of that name.
    """
    element = next((child for child in holder.children if child.name == name and child.tag[0].isupper()), None)
    if element is not None:
        return read_function_element(element)
    wrapped = holder.find(name)
    return read_function(wrapped) if wrapped is not None and wrapped.children else None


def read_function_element(element: Element) -> Function:
    if element.tag in _WITHOUT_CURVATURE:
        raise element.refusal(
            "has its slope for its curvature in OpenSim 4.6, so that accelerations are wrong there; write it as a "
            "PolynomialFunction or a SimmSpline",
            SolverCode.UNSUPPORTED,
        )
    if element.tag not in _READERS:
        raise element.unsupported("function", ", ".join(_READERS))
    return _READERS[element.tag](element)


def _constant(element: Element) -> Function:
    return polynomial([element.number("value", "0")])


def _line(element: Element) -> Function:
    return polynomial(element.numbers("coefficients", 2, "1 0")[::-1])


def _polynomial(element: Element) -> Function:
    return polynomial(element.series("coefficients")[::-1])


def _multiple(element: Element) -> Function:
    return scaled(read_function(element.child("function")), element.number("scale", "1"))


def _sine(element: Element) -> Function:
    defaults = {"amplitude": "1", "omega": "1", "phase": "0", "offset": "0"}
    return Sine(*(element.number(tag, default) for tag, default in defaults.items()))


def _step(element: Element) -> Function:
    start, end = element.number("transition_start_time", "0.99"), element.number("transition_end_time", "1.01")
    if start == end:
        raise element.refusal(f"starts and ends its transition at {start}; the solver needs room between them")
    return smooth_step(start, end, element.number("start_value", "0"), element.number("end_value", "1"))


def _natural_spline(element: Element) -> Function:
    if element.number("error_variance", "0") != 0.0:
        raise element.refusal(
            "smooths its points; the solver supports only splines through them (error_variance 0)",
            SolverCode.UNSUPPORTED,
        )
    half_order = int(element.number("half_order"))
    return natural_spline(*_points(element, fewest=2 * half_order), half_order)


def _simm_spline(element: Element) -> Function:
    """SIMM's splines may repeat an x between their ends."""
    x, y = _points(element, may_repeat=True)
    return _shared_simm_spline(tuple(x), tuple(y))


@lru_cache(maxsize=256)
def _shared_simm_spline(x: tuple[float, ...], y: tuple[float, ...]) -> Function:
    """One function for the same points: muscles with the same curves are evaluated together."""
    return simm_spline(np.array(x), np.array(y))


def _points(element: Element, fewest: int = 2, *, may_repeat: bool = False) -> tuple[Array, Array]:
    x, y = element.series("x"), element.series("y")
    steps = np.diff(x)
    is_rising = bool(np.all(steps >= 0.0) and x[0] < x[-1]) if may_repeat and len(x) > 2 else np.all(steps > 0.0)
    if len(x) != len(y) or len(x) < fewest or not is_rising:
        raise element.refusal(f"has {len(x)} x and {len(y)} y; the solver needs {fewest} or more of both, x increasing")
    return x, y


_WITHOUT_CURVATURE = ("ExpressionBasedFunction", "MultivariatePolynomialFunction")
_READERS: dict[str, Callable[[Element], Function]] = {
    "Constant": _constant,
    "LinearFunction": _line,
    "PolynomialFunction": _polynomial,
    "SimmSpline": _simm_spline,
    "PiecewiseLinearFunction": lambda element: piecewise_linear(*_points(element)),
    "PiecewiseConstantFunction": lambda element: piecewise_constant(*_points(element)),
    "GCVSpline": _natural_spline,
    "StepFunction": _step,
    "Sine": _sine,
    "MultiplierFunction": _multiple,
}
