"""The verbs, in the order of the data. Each is a short function in station/verbs, by where on the way it works.

Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but samples, a trial's end or a frame are missing, or a file has
changed since it was recorded; 130 Ctrl-C.
stdout carries results, stderr messages, both in UTF-8.
"""

from __future__ import annotations

import io
import os
import re
import sys
from importlib.metadata import version
from typing import Annotated, NoReturn

import typer

from documents.plain_data import PlainDataError
from drivers.errors import DeviceError
from fitting.errors import FitError
from recordings.errors import RecordingError
from solver.errors import SolverError
from station.errors import StationError
from station.exit_code import DONE, FAILED, INTERRUPTED
from station.extras import with_extras
from station.verbs import bench, cuffs, files, kinematics, muscles, whole
from station.verbs.options import say

ROOTS = (StationError, DeviceError, RecordingError, FitError, SolverError, PlainDataError)
"""One root of exceptions for each folder, with its exit code."""

WAY = {
    "Try it": (whole.demo,),
    "At the bench": (bench.simulate, bench.check, bench.record, whole.serve),
    "Recordings": (files.info, files.replay, files.recover, files.import_, files.export),
    "Cuff parameters": (whole.judge, cuffs.fit),
    "The body in motion": (kinematics.scale, kinematics.ik),
    "The suit on the muscles": (muscles.rmr, muscles.assess, muscles.optimise, muscles.sweep),
    "Report": (whole.report, whole.verify),
}
"""Where on the way, from left to right → its verbs."""
VERBS = {verb.__name__.rstrip("_"): verb for verbs in WAY.values() for verb in verbs}

ODD_NAMES = "backslashreplace" if sys.platform == "win32" else "surrogateescape"
"""A name that is no text keeps its bytes; on Windows it has none but halves of UTF-16 pairs, which are spelt out."""

app = typer.Typer(
    help=f"From the cuff on the bench to the muscles under the suit, left to right: {', '.join(list(VERBS)[1:])}. "
    "`demo` walks the whole way on simulated devices.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(is_asked: bool) -> None:
    if is_asked:
        print(f"cuffstation {version('cuffstation')}")
        raise typer.Exit


@app.callback()
def _station(
    _version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None: ...


for place, verbs in WAY.items():
    for verb in verbs:
        word = verb.__name__.rstrip("_")
        app.command(word, rich_help_panel=place)(with_extras(verb, word))


def main() -> NoReturn:
    """Run the verb. An exception below one of ROOTS is a sentence for the user; any other is a bug and is shown."""
    # The last digits of a product hang on how many threads share it; the same input shall give the same bytes anywhere.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _ready_streams()
    try:
        app()
    except SystemExit as ended:
        if ended.code == INTERRUPTED:
            say("station: ended by Ctrl-C; what was finished is kept")
        raise
    except Exception as error:
        if not isinstance(error, (*ROOTS, OSError)):
            raise
        say(f"station: {_one_line(error)}")
        sys.exit(error.exit_code if isinstance(error, ROOTS) else FAILED)
    sys.exit(DONE)


def _ready_streams() -> None:
    """Both speak UTF-8, a name that is not UTF-8 keeps its bytes, and one that is closed swallows what it is told."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115  (until we end)
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors=ODD_NAMES)


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and type(error).__module__ == "builtins" and error.strerror:
        name = error.filename2 or error.filename
        return f"{os.fsdecode(name)} cannot be used: {error.strerror}" if name else error.strerror
    return re.sub(r"\[Errno -?\d+\] ", "", " ".join(str(error).split())) or type(error).__name__
