"""A table for the terminal that loses nothing on a narrow one."""

from __future__ import annotations

from typing import Any

from rich.table import Table


class FoldedTable(Table):
    """Long cells continue on the next line: a number or a key is never shortened."""

    def add_column(self, *args: Any, **kwargs: Any) -> None:
        super().add_column(*args, **{"overflow": "fold", **kwargs})
