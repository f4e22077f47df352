"""The verbs, in the order of the data. Each is a short function in station/verbs, by where on the way it works.

Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but samples, a trial's end or a frame are missing.
stdout carries data, stderr talk.
"""

from __future__ import annotations

import sys
from typing import NoReturn

import typer

from station.exit_code import DONE, FAILED
from station.verbs import bench, cuffs, files, muscles, whole
from station.verbs.options import say

ROOMS = ("station", "drivers", "recordings", "fitting", "solver")

VERBS = {
    verb.__name__.rstrip("_"): verb
    for verb in (
        whole.demo,
        bench.simulate,
        bench.check,
        bench.record,
        whole.serve,
        files.info,
        files.replay,
        files.recover,
        files.import_,
        files.export,
        whole.judge,
        cuffs.fit,
        muscles.rmr,
        muscles.assess,
        muscles.optimise,
        muscles.sweep,
        whole.report,
    )
}

app = typer.Typer(
    help=f"From the cuff on the bench to the muscles under the suit, left to right: {', '.join(list(VERBS)[1:])}. "
    "`demo` walks the whole way on simulated devices.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for name, verb in VERBS.items():
    app.command(name)(verb)


def main() -> NoReturn:
    """Runs the verb. An exception born in our house is a sentence for the user; any other is a bug and shows itself."""
    try:
        app()
    except Exception as error:
        if type(error).__module__.split(".")[0] not in ROOMS and not isinstance(error, OSError):
            raise
        say(f"station: {_one_line(error)}")
        sys.exit(getattr(error, "exit_code", FAILED))
    sys.exit(DONE)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
