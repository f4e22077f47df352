"""Mutations of a Python source: one operator, comparison, condition, constant or returned value is changed."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from types import CodeType
from typing import Any

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitOr: ast.BitAnd,
    ast.BitAnd: ast.BitOr,
}
OPPOSITES = {"min": "max", "minimum": "maximum", "argmin": "argmax", "any": "all"}
OPPOSITES |= {opposite: name for name, opposite in OPPOSITES.items()}
NOT_RUN = frozenset({"annotation", "returns", "decorator_list", "type_params", "type_comment"})


@dataclass(frozen=True)
class Mutation:
    """number and line: where the changed expression begins; change: it before and after."""

    number: int
    line: str
    change: str
    _tree: ast.Module
    _slot: _Slot
    _changed: ast.AST

    @property
    def key(self) -> tuple[str, str]:
        return self.line, self.change

    def compiled(self, path: str) -> CodeType:
        """The mutated source as code of the file at path."""
        self._slot.put(ast.fix_missing_locations(ast.copy_location(self._changed, self._slot.node)))
        code: CodeType = compile(self._tree, path, "exec")
        self._slot.put(self._slot.node)
        return code


def list_mutations(source: str) -> list[Mutation]:
    """All mutations of the source, in the order of its lines. Equal changes of equal lines are numbered."""
    tree, lines, seen, found = ast.parse(source), source.splitlines(), Counter[tuple[str, str]](), []
    for slot in _slots(tree, None, is_decisive=False):
        for changed in _changed(slot):
            number = slot.node.lineno
            line, change = lines[number - 1].strip(), f"{_text(slot.node)} → {_text(changed)}"
            seen[line, change] += 1
            if seen[line, change] > 1:
                change = f"{change} ({seen[line, change]})"
            found.append(Mutation(number, line, change, tree, slot, changed))
    return sorted(found, key=lambda mutation: mutation.number)


@dataclass(frozen=True)
class _Slot:
    """Place of an expression or a return in the tree. returns: annotation of the function around it; is_condition:
    whether a branch depends on it; is_decisive: whether a text here is compared or looked up.
    """

    node: ast.expr | ast.stmt
    parent: ast.AST
    field: str
    index: int | None
    returns: str
    is_decisive: bool

    @property
    def is_condition(self) -> bool:
        return self.field in ("test", "ifs")

    def put(self, node: ast.AST) -> None:
        if self.index is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.index] = node


def _slots(parent: ast.AST, returns: str | None, *, is_decisive: bool) -> Iterator[_Slot]:
    if isinstance(parent, ast.FunctionDef):
        returns = ast.unparse(parent.returns) if parent.returns else ""
    for field, value in ast.iter_fields(parent):
        if field in NOT_RUN:
            continue
        decides = isinstance(parent, ast.Compare | ast.MatchValue) or field in ("slice", "keys")
        decides |= is_decisive and isinstance(parent, ast.Tuple | ast.List | ast.Set)
        for index, node in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(node, ast.AST) or _is_skipped(node):
                continue
            if isinstance(node, ast.expr | ast.Return):
                yield _Slot(node, parent, field, index, returns or "", decides)
            yield from _slots(node, returns, is_decisive=decides)


def _is_skipped(node: ast.AST) -> bool:
    """Docstrings, texts with values and their formats, imports for type checking, types, and zip's check of lengths."""
    is_docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    is_typing = isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    is_type = isinstance(node, ast.Subscript) and ast.unparse(node.value) in ("Literal", "Callable", "NDArray")
    is_check = isinstance(node, ast.keyword) and node.arg == "strict"
    return is_docstring or is_typing or is_type or is_check or isinstance(node, ast.JoinedStr)


def _changed(slot: _Slot) -> Iterator[ast.AST]:
    node = slot.node
    if slot.is_condition and not isinstance(node, ast.Compare) and not _is_not(node):
        yield ast.UnaryOp(ast.Not(), node)  # type: ignore[arg-type]
    match node:
        case ast.Compare():
            for i, operator in enumerate(node.ops):
                for other in COMPARISONS[type(operator)]:
                    yield _with(node, ops=[*node.ops[:i], other(), *node.ops[i + 1 :]])
        case ast.BinOp(op=operator) if type(operator) in OPERATORS:
            yield _with(node, op=OPERATORS[type(operator)]())
        case ast.BoolOp(op=operator):
            yield _with(node, op=ast.Or() if isinstance(operator, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield node.operand
        case ast.Call(func=ast.Name(id=name)) if name in OPPOSITES:
            yield _with(node, func=ast.Name(OPPOSITES[name], ast.Load()))
        case ast.Call(func=ast.Attribute(attr=name)) if name in OPPOSITES:
            yield _with(node, func=_with(node.func, attr=OPPOSITES[name]))
        case ast.Constant():
            yield from (ast.Constant(value) for value in _other_values(node.value, is_decisive=slot.is_decisive))
        case ast.Return(value=ast.expr() as value):
            yield from (ast.Return(other) for other in _other_returns(value, slot.returns))


def _is_not(node: ast.AST) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)


def _with(node: ast.AST, **changes: object) -> ast.AST:
    other = copy(node)
    for name, value in changes.items():
        setattr(other, name, value)
    return other


def _other_values(value: object, *, is_decisive: bool) -> list[Any]:
    match value:
        case bool():
            return [not value]
        case int():
            return [value + 1 if abs(value) < 100 else value * 3 // 2]
        case float():
            return [1.5 * value if value else 1.0]
        case str() if is_decisive:
            return [f"{value}!"]
    return []


def _other_returns(value: ast.expr, returns: str) -> list[ast.expr]:
    """Other values for a return; a returned constant is changed as a constant."""
    if isinstance(value, ast.Constant):
        return []
    if returns == "bool":
        return [ast.Constant(True), ast.Constant(False)]
    if returns in ("float", "int") or "Array" in returns.partition("[")[0]:
        return [ast.BinOp(value, ast.Mult(), ast.Constant(1.5))]
    return [ast.Constant(None)]


def _text(node: ast.AST) -> str:
    text = ast.unparse(node)
    return text if len(text) <= 100 else f"{text[:100]}…"
