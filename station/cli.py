"""The verbs, in the order of the data. Each is a short function in station/verbs, by where on the way it works.

Exit codes: 0 done; 1 failed; 2 wrong usage; 3 done, but samples, a trial's end or a frame are missing.
stdout carries data, stderr talk.
"""

from __future__ import annotations

import os
import sys
from typing import NoReturn

import typer

from station.exit_code import DONE, FAILED
from station.verbs import bench, cuffs, files, muscles, whole
from station.verbs.options import say

ROOMS = ("station", "drivers", "recordings", "fitting", "solver")

WAY = {
    "Try it": (whole.demo,),
    "At the bench": (bench.simulate, bench.check, bench.record, whole.serve),
    "Recordings": (files.info, files.replay, files.recover, files.import_, files.export),
    "Cuff parameters": (whole.judge, cuffs.fit),
    "The suit on the muscles": (muscles.rmr, muscles.assess, muscles.optimise, muscles.sweep),
    "Report": (whole.report,),
}
"""Where on the way, from left to right → its verbs."""
VERBS = {verb.__name__.rstrip("_"): verb for verbs in WAY.values() for verb in verbs}

app = typer.Typer(
    help=f"From the cuff on the bench to the muscles under the suit, left to right: {', '.join(list(VERBS)[1:])}. "
    "`demo` walks the whole way on simulated devices.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for place, verbs in WAY.items():
    for verb in verbs:
        app.command(verb.__name__.rstrip("_"), rich_help_panel=place)(verb)


def main() -> NoReturn:
    """Runs the verb. An exception born in our house is a sentence for the user; any other is a bug and shows itself."""
    # The last digits of a product hang on how many threads share it; the same input shall give the same bytes anywhere.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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
