"""Signatures of operators, looked up once for the same types of arguments.

For `a * b` numba tries up to 18 implementations, most of which raise an error. It does so at every place in the code,
and again when it lowers that place to LLVM: a quarter of its own time, in which each answer is the same.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

FUNCTIONS = (
    *(operator.add, operator.sub, operator.mul, operator.truediv, operator.floordiv, operator.mod, operator.pow),
    *(operator.iadd, operator.isub, operator.imul, operator.itruediv, operator.neg, operator.not_),
    *(operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne, operator.is_),
    *(operator.getitem, operator.setitem, abs, bool, len, max, min),
)


def remember_signatures(typing: Any) -> None:
    """Give the FUNCTIONS of numba's typing context a memory of the signatures that they have found."""
    for function in FUNCTIONS:
        resolved = typing.resolve_value_type(function)
        if "get_call_type" not in vars(resolved):  # else from an earlier kernel; numba replaces what it extends
            resolved.get_call_type = _remembering(resolved.get_call_type)


def _remembering(find: Callable[..., Any]) -> Callable[..., Any]:
    found: dict[tuple[Any, ...], Any] = {}

    def get_call_type(context: Any, arguments: Any, keywords: Any) -> Any:
        if keywords:
            return find(context, arguments, keywords)
        types = tuple(arguments)
        if types not in found:
            found[types] = find(context, arguments, keywords)
        return found[types]

    return get_call_type
