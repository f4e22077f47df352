"""Lists of fields in our docstrings (a name, its meaning in columns) as lists of the site: an extension of griffe."""

from __future__ import annotations

import re
from typing import Any

import griffe

FIELD = re.compile(r"^(\w+(?:, \w+)*)(?: {2,})(\S.*)$")
CONTINUED = re.compile(r"^ {4,}(\S.*)$")


class FieldLists(griffe.Extension):  # type: ignore[misc]
    """`name     meaning` on a line of its own, continued below where it is indented, becomes an item of a list."""

    def on_class_instance(self, *, cls: griffe.Class, **_: Any) -> None:
        if cls.docstring is not None:
            cls.docstring.value = with_lists(cls.docstring.value)


def with_lists(text: str) -> str:
    """The docstring in Markdown: fields as items, all else as it is."""
    lines: list[str] = []
    for line in text.splitlines():
        if field := FIELD.match(line):
            if lines and lines[-1] and not lines[-1].startswith("- "):
                lines.append("")
            lines.append(f"- `{field[1]}`: {field[2]}")
        elif (more := CONTINUED.match(line)) and lines and lines[-1].startswith("- "):
            lines[-1] += f" {more[1]}"
        else:
            lines.append(line)
    return "\n".join(lines)
