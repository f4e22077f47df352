"""Labels of published marker sets, from marker_presets.toml, which gives the sources."""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

NO_BODY = ("source", "markers")


def preset_labels(name: str, prefix: str = "") -> tuple[str, ...]:
    """The labels of a body, such as "qualisys_sports.left_arm", with the prefix. Raises ValueError for another name.

    The labels of a skeleton in QTM start with the name of the person, for example "Anna_".
    """
    known = {
        f"{marker_set}.{body}": labels for marker_set, bodies in _presets().items() for body, labels in bodies.items()
    }
    if name not in known or name.rpartition(".")[2] in NO_BODY:
        bodies = ", ".join(body for body in known if body.rpartition(".")[2] not in NO_BODY)
        raise ValueError(f"{name!r} is not a preset, expected one of {bodies}")
    return tuple(prefix + label for label in known[name])


@cache
def _presets() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
