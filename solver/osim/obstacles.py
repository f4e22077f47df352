"""Collect the unsupported parts of a model, so that a refusal names everything to change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from solver.errors import SolverCode
from solver.model import ModelError
from solver.osim.document import Element

S = TypeVar("S")
T = TypeVar("T")

MOST_NAMED = 20


class Obstacles:
    """Unsupported parts of one <Model>."""

    def __init__(self, model: Element) -> None:
        self._model = model
        self._found: dict[str, SolverCode] = {}  # by sentence

    def among(self, read: Callable[[S], T], elements: Iterable[S]) -> list[T]:
        """Read the supported elements; keep the reasons for refusing the others."""
        results = []
        for element in elements:
            try:
                results.append(read(element))
            except ModelError as error:
                self._found[str(error)] = error.code
        return results

    def ensure_none(self) -> None:
        """Raises ModelError with every obstacle; its code is that of the first."""
        if not self._found:
            return
        sentences, code = list(self._found), next(iter(self._found.values()))
        if len(sentences) == 1:
            raise ModelError(sentences[0], code)
        more = f"; and {len(sentences) - MOST_NAMED} more" if len(sentences) > MOST_NAMED else ""
        raise ModelError(
            f"{self._model.file.name} cannot be solved for {len(sentences)} reasons: "
            f"{'; '.join(sentences[:MOST_NAMED])}{more}",
            code,
        )
