"""Packages beyond the small install: their extras, and the verbs that need them."""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.util import find_spec
from typing import ParamSpec, TypeVar

from documents.message import Message
from station.errors import StationError
from station.exit_code import FAILED
from station.messages.setup_messages import ConfigCode

P = ParamSpec("P")
R = TypeVar("R")

PACKAGES = {
    "bench": ("grpc", "nidaqmx", "qtm_rt", "serial", "session_pb2"),
    "console": ("nicegui", "starlette"),
    "lsl": ("pylsl",),
    "viewer": ("rerun",),
    "cluster": ("distributed", "pyarrow"),
    "sensitivity": ("SALib",),
    "formats": ("foxglove_schemas_protobuf", "mcap_protobuf", "pyarrow"),
    "catalogue": ("duckdb",),
    "xarray": ("xarray",),
    "pdf": ("playwright",),
}
"""Extra → the modules that are imported from its packages."""
EXTRAS_OF_VERB = {
    "demo": ("bench",),
    "simulate": ("bench",),
    "check": ("bench",),
    "record": ("bench",),
    "serve": ("bench", "console"),
    "sweep": ("cluster",),
    "catalogue": ("catalogue",),
}
"""A verb that is not listed needs no extra, or one for an option only (`replay --rerun`, `export --to parquet`)."""


class MissingExtra(StationError):
    """The package of an extra is not installed."""

    exit_code = FAILED

    def __init__(self, purpose: str, package: str, extra: str) -> None:
        figures = {"purpose": purpose, "package": package, "extra": extra}
        super().__init__(Message(ConfigCode.MISSING_PACKAGE, figures))


def with_extras(verb: Callable[P, R], name: str) -> Callable[P, R]:
    """Raise MissingExtra if a package of an extra is missing: before the verb starts, or at the import."""

    @functools.wraps(verb)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        missing = {
            extra: package
            for extra in EXTRAS_OF_VERB.get(name, ())
            for package in reversed(PACKAGES[extra])
            if not _is_installed(package)
        }
        if missing:  # all extras in one sentence, so that one installation is enough
            raise MissingExtra(f"station {name}", next(iter(missing.values())), ",".join(missing))
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
