"""Functions of one coordinate, as in OpenSim models: for joint axes, moving path points, coupled coordinates.

Each gives its value with its first two derivatives. All of OpenSim's are piecewise polynomials, but for the sine.

Expression is an arithmetic expression in text, as in OpenSim's expression-based forces, whose parser is Lepton's:
operators + − * / ^, functions of one or two arguments, and definitions behind semicolons: "k*d^2; k=30". Nothing else
is evaluated, so that an expression of a foreign file cannot run code.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from documents.interval import counted
from solver.errors import ModelError

Array = NDArray[np.float64]
Derivatives = tuple[Array, Array, Array]
"""Value, slope and curvature of a function, each of the shape of its argument."""
LEAST_PIECE = 1e-7
LONGEST, DEEPEST = 5000, 200


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """On piece i: Σ_k coefficients[i, k] (x − origins[i])ᵏ.

    breaks        (pieces − 1,) where a piece ends and the next begins; the first and the last are unbounded
    origins       (pieces,)
    coefficients  (pieces, degree + 1) the lowest power first
    """

    breaks: Array
    origins: Array
    coefficients: Array

    def derivatives(self, x: Array) -> Derivatives:
        piece = np.searchsorted(self.breaks, x, side="right")
        local, powers = x - self.origins[piece], self.coefficients[piece]
        value, slope, curvature = (np.zeros_like(local) for _ in range(3))
        for k in range(powers.shape[-1] - 1, -1, -1):
            curvature = curvature * local + 2.0 * slope
            slope = slope * local + value
            value = value * local + powers[..., k]
        return value, slope, curvature

    @cached_property
    def is_identity(self) -> bool:
        value, slope, bend = self.derivatives(np.array([-1.0, 0.0, 1.0]))
        return bool(np.array_equal(value, [-1.0, 0.0, 1.0]) and np.all(slope == 1.0) and not bend.any())


@dataclass(frozen=True)
class Sine:
    """amplitude · sin(omega · x + phase) + offset."""

    amplitude: float
    omega: float
    phase: float
    offset: float

    def derivatives(self, x: Array) -> Derivatives:
        angle = self.omega * x + self.phase
        swing = self.amplitude * np.sin(angle)
        return swing + self.offset, self.amplitude * self.omega * np.cos(angle), -(self.omega**2) * swing


Function = PiecewisePolynomial | Sine


def polynomial(coefficients: ArrayLike) -> PiecewisePolynomial:
    """The polynomial with these coefficients (degree + 1,), the lowest power first."""
    return _pieces([], [0.0], np.atleast_2d(np.asarray(coefficients, dtype=float)))


def scaled(function: Function, factor: float) -> Function:
    """The function times a factor."""
    if isinstance(function, Sine):
        return Sine(factor * function.amplitude, function.omega, function.phase, factor * function.offset)
    return _pieces(function.breaks, function.origins, factor * function.coefficients)


def piecewise_linear(x: Array, y: Array) -> PiecewisePolynomial:
    """Straight lines through points (knots,), x increasing; the first and the last line are extended."""
    return _pieces(x[1:-1], x[:-1], np.column_stack([y[:-1], np.diff(y) / np.diff(x)]))


def piecewise_constant(x: Array, y: Array) -> PiecewisePolynomial:
    """y[i] from x[i] to x[i + 1]; the first and the last value are extended."""
    return _pieces(x[1:], x, y[:, None])


def smooth_step(start: float, end: float, low: float, high: float) -> PiecewisePolynomial:
    """From `low` at `start` to `high` at `end`, 10 t³ − 15 t⁴ + 6 t⁵ between them; start may be beyond end."""
    rise = (high - low) * np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / (end - start) ** np.arange(6.0)
    coefficients = np.zeros((3, 6))
    coefficients[:, 0] = low
    coefficients[1] += rise
    coefficients[2, 0] = high
    if end < start:
        coefficients[[0, 2]] = coefficients[[2, 0]]
    return _pieces(sorted([start, end]), [start] * 3, coefficients)


def simm_spline(x: Array, y: Array) -> PiecewisePolynomial:
    """OpenSim's SimmSpline through points (knots,), x not decreasing: cubic, straight beyond its ends.

    Its third derivatives at the ends are those of the cubics through the first and through the last four points.
    OpenSim computes the coefficients of a piece that is shorter than LEAST_PIECE as if it were that long.
    """
    if len(x) == 2:
        return piecewise_linear(x, y)
    h = np.maximum(np.diff(x), LEAST_PIECE)
    slope = np.diff(y) / h
    last = len(x) - 1
    matrix, right = np.zeros((len(x), len(x))), np.zeros(len(x))  # of the curvatures over 6
    for i in range(1, last):
        matrix[i, i - 1 : i + 2] = h[i - 1], 2.0 * (h[i - 1] + h[i]), h[i]
        right[i] = slope[i] - slope[i - 1]
    matrix[0, :2], matrix[last, last - 1 :] = (-h[0], h[0]), (h[-1], -h[-1])
    if len(x) > 3:
        second = np.diff(slope) / (x[2:] - x[:-2])
        third = np.diff(second) / (x[3:] - x[:-3])
        right[0], right[last] = h[0] ** 2 * third[0], -(h[-1] ** 2) * third[-1]
    bend = np.linalg.solve(matrix, right)
    first_slope = slope - h * (bend[1:] + 2.0 * bend[:-1])
    end_slope = slope[-1] + h[-1] * (bend[-2] + 2.0 * bend[-1])
    inner = np.column_stack([y[:-1], first_slope, 3.0 * bend[:-1], np.diff(bend) / h])
    before, beyond = [y[0], first_slope[0], 0.0, 0.0], [y[-1], end_slope, 0.0, 0.0]
    return _pieces(x, [x[0], *x], np.vstack([before, inner, beyond]))


def natural_spline(x: Array, y: Array, half_order: int) -> PiecewisePolynomial:
    """The natural spline of degree 2 half_order − 1 through points (knots,): OpenSim's GCVSpline without smoothing.

    Beyond its ends it is a polynomial of degree half_order − 1.
    """
    spline = natural_interpolation(x, y, half_order)
    inner = scipy.interpolate.PPoly.from_spline(spline)
    is_piece = np.diff(inner.x) > 0.0
    origins, coefficients = inner.x[:-1][is_piece], inner.c[::-1].T[is_piece]
    ends = np.zeros((2, coefficients.shape[1]))
    factorial = 1.0
    for order in range(half_order):
        factorial *= max(order, 1)
        ends[:, order] = spline(x[[0, -1]], nu=order) / factorial
    return _pieces(x, [x[0], *origins, x[-1]], np.vstack([ends[0], coefficients, ends[1]]))


def natural_interpolation(x: Array, y: Array, half_order: int) -> Any:
    """SciPy's spline of degree 2 half_order − 1 through y (knots, …), with ends that natural splines have."""
    flat = [(order, np.zeros(y.shape[1:])) for order in range(half_order, 2 * half_order - 1)]
    ends_are_flat: Any = (flat, flat) if flat else None
    return scipy.interpolate.make_interp_spline(x, y, k=2 * half_order - 1, bc_type=ends_are_flat)


def _pieces(breaks: ArrayLike, origins: ArrayLike, coefficients: Array) -> PiecewisePolynomial:
    values = [np.array(numbers, dtype=float) for numbers in (breaks, origins, coefficients)]
    for array in values:
        array.flags.writeable = False
    return PiecewisePolynomial(*values)


class ExpressionError(ModelError):
    """End of a sentence about a property of a model: the part of its expression that the parser does not support."""


@dataclass(frozen=True)
class Expression:
    """A formula in these variables. Raises ExpressionError for one that is not arithmetic in them."""

    text: str
    variables: tuple[str, ...]

    def __post_init__(self) -> None:
        known = self.variables
        for name, formula in _parsed(self.text):
            _ensure_known(formula, known)
            known = (*known, name)

    def at(self, *values: Array) -> Array:
        """The value (frames,) for values (frames,) of the variables in order; NaN or infinite where it is undefined."""
        scope: dict[str, Any] = dict(zip(self.variables, values, strict=True))
        with np.errstate(all="ignore"):
            for name, formula in _parsed(self.text):
                scope[name] = _evaluated(formula, scope)
        return np.broadcast_to(scope[_RESULT], values[0].shape).copy()


_RESULT = ""


@lru_cache(maxsize=256)
def _parsed(text: str) -> tuple[tuple[str, ast.expr], ...]:
    """Names and formulas in the order of evaluation: the last definition first, the result at the end."""
    if len(text) > LONGEST:
        raise ExpressionError(f"is longer than {LONGEST} characters")
    result, *definitions = text.split(";")
    found = []
    for definition in reversed([part.strip() for part in definitions if part.strip()]):
        name, equals, formula = definition.partition("=")
        if not equals or not name.strip().isidentifier():
            raise ExpressionError(f"has the definition '{definition}', expected name=formula")
        found.append((name.strip(), _tree(formula)))
    return (*found, (_RESULT, _tree(result)))


def _tree(formula: str) -> ast.expr:
    if "**" in formula:
        raise ExpressionError(f"has '{formula.strip()}', which is not arithmetic")
    try:
        return ast.parse("".join(formula.split()).replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
        raise ExpressionError(f"has '{formula.strip()[:80]}', which is not arithmetic") from error


def _ensure_known(node: ast.expr, variables: tuple[str, ...], depth: int = 0) -> None:
    if depth > DEEPEST:
        raise ExpressionError(f"is nested more than {DEEPEST} deep")
    parts: list[ast.expr]
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        parts = []
    elif isinstance(node, ast.Name):
        if node.id not in variables:
            raise ExpressionError(f"has the unknown variable {node.id}, expected {', '.join(variables)}")
        parts = []
    elif isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        parts = [node.operand]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        arguments, _ = _FUNCTIONS.get(node.func.id, (0, np.negative))
        if arguments != len(node.args):
            raise ExpressionError(f"has the unknown function {node.func.id} of {counted(len(node.args), 'argument')}")
        parts = node.args
    else:
        raise ExpressionError(f"has '{ast.unparse(node)[:80]}', which is not arithmetic")
    for part in parts:
        _ensure_known(part, variables, depth + 1)


def _evaluated(node: ast.expr, scope: Mapping[str, Array]) -> Any:
    """Of a tree that _ensure_known accepts."""
    if isinstance(node, ast.Constant):
        return np.float64(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.Name):
        return scope[node.id]
    if isinstance(node, ast.UnaryOp):
        return -_evaluated(node.operand, scope)
    if isinstance(node, ast.BinOp):
        return _OPERATORS[type(node.op)](_evaluated(node.left, scope), _evaluated(node.right, scope))
    assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)  # noqa: S101 (for the type checker)
    return _FUNCTIONS[node.func.id][1](*(_evaluated(part, scope) for part in node.args))


def _error_function(x: Array) -> Array:
    return np.asarray(scipy.special.erf(x))


_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: np.power,
}
_FUNCTIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    **{name: (1, getattr(np, name)) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{name: (1, getattr(np, f"arc{name[1:]}")) for name in ("asin", "acos", "atan")},
    "sec": (1, lambda x: 1.0 / np.cos(x)),
    "csc": (1, lambda x: 1.0 / np.sin(x)),
    "cot": (1, lambda x: 1.0 / np.tan(x)),
    "erf": (1, _error_function),
    "erfc": (1, lambda x: 1.0 - _error_function(x)),
    "step": (1, lambda x: np.where(x >= 0.0, 1.0, 0.0)),
    "delta": (1, lambda x: np.where(x == 0.0, 1.0, 0.0)),
    "square": (1, np.square),
    "cube": (1, lambda x: x * x * x),
    "recip": (1, lambda x: 1.0 / x),
    "abs": (1, np.abs),
    "min": (2, np.minimum),
    "max": (2, np.maximum),
}
