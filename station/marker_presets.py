"""Labels of published marker sets, read from the table beside this file, which names its sources."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

NO_BODY = ("source", "markers")


def preset_labels(name: str, prefix: str = "") -> tuple[str, ...]:
    """The labels of one body, "qualisys_sports.left_arm", each behind the prefix. Raises ValueError in a sentence.

    QTM puts the name of the person before the labels of a skeleton: there prefix is "Anna_" or the like.
    """
    known = {f"{of}.{body}": labels for of, bodies in _presets().items() for body, labels in bodies.items()}
    if name not in known or name.rpartition(".")[2] in NO_BODY:
        bodies = ", ".join(each for each in known if each.rpartition(".")[2] not in NO_BODY)
        raise ValueError(f"{name!r} is no preset, expected one of {bodies}")
    return tuple(prefix + label for label in known[name])


@cache
def _presets() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
