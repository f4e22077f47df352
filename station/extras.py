"""The packages beyond the small install: the extra that installs each, and the verbs that cannot start without one."""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.util import find_spec
from typing import ParamSpec, TypeVar

from station.errors import StationError
from station.exit_code import FAILED

P = ParamSpec("P")
R = TypeVar("R")

PACKAGES = {
    "bench": ("grpc", "nidaqmx", "qtm_rt", "serial", "session_pb2"),
    "console": ("nicegui", "starlette"),
    "viewer": ("rerun",),
    "cluster": ("distributed", "pyarrow"),
    "formats": ("ezc3d", "foxglove_schemas_protobuf", "mcap_protobuf", "pyarrow"),
}
"""Extra → the modules that are imported from its packages."""
EXTRAS_OF_VERB = {
    "demo": ("bench",),
    "simulate": ("bench",),
    "check": ("bench",),
    "record": ("bench",),
    "serve": ("bench", "console"),
    "sweep": ("cluster",),
}
"""A verb that is not listed needs none, or needs one for an option (`replay --rerun`, `export --to c3d`)."""


class MissingExtra(StationError):
    """A package is not installed because its extra was not asked for."""

    exit_code = FAILED

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        super().__init__(
            f"{purpose} needs the package {package}, which is not installed; install the extra that has it: "
            f"pip install -e '.[{extra}]'"
        )


def with_extras(verb: Callable[P, R], name: str) -> Callable[P, R]:
    """End the verb in one sentence if a package of an extra is missing: before it starts, or at the import."""

    @functools.wraps(verb)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for extra in EXTRAS_OF_VERB.get(name, ()):
            for package in PACKAGES[extra]:
                if not _is_installed(package):
                    raise MissingExtra(f"station {name}", package, extra)
        try:
            return verb(*args, **kwargs)
        except ModuleNotFoundError as error:
            package = (error.name or "").split(".")[0]
            for extra, packages in PACKAGES.items():
                if package in packages:
                    raise MissingExtra(f"this option of station {name}", package, extra) from error
            raise

    return checked


def _is_installed(package: str) -> bool:
    try:
        return find_spec(package) is not None
    except ModuleNotFoundError:
        return False
