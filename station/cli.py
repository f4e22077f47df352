"""The verbs in the order of the data, short functions in station/verbs.

Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but samples, the end of a trial or a frame are missing, or a file
has changed since it was recorded; 130 Ctrl-C. Results go to stdout, messages to stderr, both in UTF-8. If the reader of
stdout closes early, as in `station info FILE | head -1`, the rest is discarded, and the verb continues.
"""

from __future__ import annotations

import errno
import io
import math
import os
import re
import sys
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, get_args, get_type_hints

import typer
from rich.markup import escape
from typer.core import TyperArgument, TyperCommand, TyperOption

from documents.plain_data import PlainDataError
from drivers.errors import DeviceError
from fitting.errors import FitError
from recordings.errors import RecordingError
from solver.errors import SolverError
from station.errors import StationError
from station.exit_code import DONE, ENDED_BY_CTRL_C, FAILED, INTERRUPTED
from station.extras import with_extras
from station.verbs import bench, files, kinematics, muscles, study, suits, whole
from station.verbs.options import print_message

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

LONGEST_WORD, LONGEST_SENTENCE = 260, 1200
"""Characters; the path of a file on Windows has up to 260."""
ROOTS = (StationError, DeviceError, RecordingError, FitError, SolverError, PlainDataError)
"""One root of exceptions for each folder, with its exit code."""

STAGES = {
    "Try it": (whole.init, whole.demo),
    "At the bench": (bench.simulate, bench.check, bench.record, bench.live, whole.serve),
    "Recordings": (files.info, files.replay, files.recover, files.import_, files.export),
    "Cuff parameters": (whole.judge, suits.fit),
    "Body and motion": (kinematics.scale, kinematics.ik),
    "Suit and muscles": (
        muscles.id_,
        muscles.rmr,
        muscles.validate,
        muscles.emg,
        suits.assess,
        suits.optimise,
        suits.sweep,
    ),
    "Many sessions": (study.plan, study.catalogue, study.study),
    "Report": (whole.report, whole.verify),
}
"""Stage of the data → its verbs, in order."""
VERBS = {verb.__name__.rstrip("_"): verb for verbs in STAGES.values() for verb in verbs}

NAME_ERRORS = "backslashreplace" if sys.platform == "win32" else "surrogateescape"
"""A name that is not UTF-8 keeps its bytes; on Windows, unpaired UTF-16 surrogates are escaped."""

app = typer.Typer(
    help=f"Measure cuffs on a bench and compute their effect on the muscles: {', '.join(list(VERBS)[1:])}. "
    "`demo` runs all stages on simulated devices.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
CLOSED = {errno.EPIPE, errno.EINVAL} if sys.platform == "win32" else {errno.EPIPE}
"""Errors of a write to a pipe without a reader."""


class Verb(TyperCommand):
    """A command with help texts that rich does not parse: "[s]" is a unit, not a style. A paragraph is one line, which
    rich wraps to the terminal.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.help = re.sub(r"(?<!\n)\n(?!\n)", " ", escape(self.help or ""))
        for parameter in self.params:
            if isinstance(parameter, TyperOption | TyperArgument):
                parameter.help = escape(parameter.help or "")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Raise BadParameter for inf and nan where an option is a number: typer accepts inf."""
        given = self.make_parser(ctx).parse_args(list(args))[0]
        types = get_type_hints(self.callback)
        for option in self.params:
            text, kind = given.get(option.name), types.get(option.name or "")
            if not isinstance(option, TyperOption) or not isinstance(text, str):
                continue
            if float in (kind, *get_args(kind)) and _is_infinite(text):
                raise typer.BadParameter(f"expected a finite number, found {text}", ctx=ctx, param=option)
        return super().parse_args(ctx, args)


def _is_infinite(text: str) -> bool:
    """Whether a number is inf or nan; False for a text: typer refuses it."""
    try:
        return not math.isfinite(float(text))
    except ValueError:
        return False


def _show_version(is_requested: bool) -> None:
    if is_requested:
        from importlib.metadata import version

        print(f"cuffstation {version('cuffstation')}")
        raise typer.Exit


@app.callback()
def _station(
    _version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_show_version, is_eager=True)
    ] = False,
) -> None: ...


for stage, verbs in STAGES.items():
    for verb in verbs:
        name = verb.__name__.rstrip("_")
        app.command(name, cls=Verb, rich_help_panel=stage)(with_extras(verb, name))


def main() -> NoReturn:
    """Run the verb. An exception below one of ROOTS is a sentence for the user; any other is a bug and is shown."""
    _ready_streams()
    try:
        app(prog_name="station")  # also if it is started by `python -m`
    except SystemExit as ended:
        if ended.code == INTERRUPTED:
            print_message(ENDED_BY_CTRL_C)
        raise
    except Exception as error:
        if not isinstance(error, (*ROOTS, OSError)):
            raise
        print_message(f"station: {_one_line(error)}{_code(error)}")
        sys.exit(error.exit_code if isinstance(error, ROOTS) else FAILED)
    sys.exit(DONE)


def _ready_streams() -> None:
    """Use UTF-8 on both streams; a name that is not UTF-8 keeps its bytes, and a closed stream discards its output."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115  (until we end)
        stream = getattr(sys, name)
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors=NAME_ERRORS)
            setattr(sys, name, without_broken_pipe(stream))


def _code(error: Exception) -> str:
    code = getattr(error, "code", "") if isinstance(error, ROOTS) else ""
    return f" [{code}]" if code else ""


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and type(error).__module__ == "builtins" and error.strerror:
        name = error.filename2 or error.filename
        return _shortened(f"{os.fsdecode(name)} cannot be used: {error.strerror}" if name else error.strerror)
    line = re.sub(r"\[(Errno|WinError) -?\d+\] ", "", " ".join(str(error).split()))
    return _shortened(line) or type(error).__name__


def _shortened(sentence: str) -> str:
    """The sentence without the middle of what is too long, as a name from a file may be."""
    kept = " ".join(_without_middle(word, LONGEST_WORD) for word in sentence.split(" "))
    return _without_middle(kept, LONGEST_SENTENCE)


def _without_middle(text: str, length: int) -> str:
    return text if len(text) <= length else f"{text[: length // 2]}…{text[-length // 2 + 1 :]}"


class ClosableOutput(io.FileIO):
    """A file descriptor that accepts everything, also after its reader has closed the pipe."""

    def write(self, data: ReadableBuffer, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in CLOSED:
                raise
            return memoryview(data).nbytes


def without_broken_pipe(stream: io.TextIOWrapper) -> io.TextIOWrapper:
    """The stream; where it is a file or a pipe, it discards what its reader no longer takes."""
    is_unbuffered = isinstance(stream.buffer, io.FileIO)  # by PYTHONUNBUFFERED
    if not (is_unbuffered or isinstance(getattr(stream.buffer, "raw", None), io.FileIO)):
        return stream
    raw = ClosableOutput(stream.fileno(), "wb", closefd=False)
    output: Any = raw if is_unbuffered else io.BufferedWriter(raw)
    return io.TextIOWrapper(
        output, stream.encoding, stream.errors, line_buffering=stream.line_buffering, write_through=stream.write_through
    )


if __name__ == "__main__":
    main()
