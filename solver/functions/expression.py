"""Arithmetic expressions in text, as in OpenSim's expression-based forces: its parser is Lepton's.

Operators + − * / ^, functions of one or two arguments, and definitions behind semicolons: "k*d^2; k=30". Nothing else
is evaluated, so that an expression of a foreign file cannot run code.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.errors import ModelError

Array = NDArray[np.float64]

LONGEST, DEEPEST = 5000, 200


class ExpressionError(ModelError):
    """The rest of a sentence about a property of a model: what its expression has that the parser does not support."""


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
            raise ExpressionError(f"has the unknown function {node.func.id} of {len(node.args)} arguments")
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
    value: Array = scipy.special.erf(x)
    return value


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
