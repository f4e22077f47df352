"""Collect the unsupported parts of a model, so that a refusal names everything to change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from solver.model import ModelError
from solver.osim.document import Element

T = TypeVar("T")

MOST_NAMED = 20


class Obstacles:
    """Of one <Model>."""

    def __init__(self, model: Element) -> None:
        self._model = model
        self._found: dict[str, None] = {}

    def among(self, read: Callable[[Element], T], elements: Iterable[Element]) -> list[T]:
        """Read the supported elements; the reasons for refusing the others are kept."""
        results = []
        for element in elements:
            try:
                results.append(read(element))
            except ModelError as error:
                self._found[str(error)] = None
        return results

    def ensure_none(self) -> None:
        """Raises ModelError with every obstacle that was found."""
        if not self._found:
            return
        sentences = list(self._found)
        if len(sentences) == 1:
            raise ModelError(sentences[0])
        more = f"; and {len(sentences) - MOST_NAMED} more" if len(sentences) > MOST_NAMED else ""
        raise ModelError(
            f"{self._model.file.name} cannot be solved for {len(sentences)} reasons: "
            f"{'; '.join(sentences[:MOST_NAMED])}{more}"
        )
