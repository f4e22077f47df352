"""With files: info, recover, import."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import typer

from station.verbs.options import ConfigPath, Format, Test, say


def info(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    format: Annotated[Format, typer.Option(help="A table for people or JSON for programs.")] = "table",  # noqa: A002
) -> None:
    """Show what is in a recording, whole or cut."""
    from station.info import show_contents

    raise typer.Exit(show_contents(file, as_json=format == "json"))


def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut.")],
    output: Annotated[Path | None, typer.Option(help="Where to; default: FILE.recovered.mcap beside it.")] = None,
) -> None:
    """Make a whole file of what a killed recording left. Never touches the original."""
    from station.info import recover_recording

    raise typer.Exit(recover_recording(file, output))


def import_(
    mocap: Annotated[Path, typer.Option(help="Markers: QTM's export as .tsv, or .trc or .c3d.")],
    session: Annotated[Path | None, typer.Option(help="Folder of the session; made if it is not there.")] = None,
    cuff: Annotated[str | None, typer.Option(help="The cuff under test; a bounce has none.")] = None,
    test: Annotated[Test | None, typer.Option(help="Which of the tests.")] = None,
    repeat: Annotated[int, typer.Option(min=1, help="Which repeat of this test on this donning.")] = 1,
    force: Annotated[Path | None, typer.Option(help="Force: a DAQ's .csv with a header, or a .c3d.")] = None,
    config: ConfigPath = Path("station.toml"),
    donning: Annotated[str, typer.Option(help="Which donning of the cuff; repeats of one are pooled.")] = "1",
    force_column: Annotated[str | None, typer.Option(help="Default: force_v, force_n or force_lbs.")] = None,
    force_unit: Annotated[
        Literal["V", "N", "lbs"] | None, typer.Option(help="Volts are calibrated by the configuration. Default: V.")
    ] = None,
    time_column: Annotated[str, typer.Option(help="The .csv's times, in seconds.")] = "time_s",
    sync_column: Annotated[str, typer.Option(help="The level of the sync line [V], where there is one.")] = "sync_v",
    mocap_unit: Annotated[
        Literal["mm", "cm", "m"] | None, typer.Option(help="Default: what the file says; mm for .tsv.")
    ] = None,
    label: Annotated[list[str] | None, typer.Option(help="THEIRS=OURS renames a marker; may be repeated.")] = None,
    lag_s: Annotated[
        float | None, typer.Option(help="A force sample stamped t was taken at t + LAG_S by the markers' time.")
    ] = None,
    lag_sd_s: Annotated[float | None, typer.Option(min=0, help="Its standard uncertainty. Default: 0.0005.")] = None,
    start: Annotated[datetime | None, typer.Option(help="When it was captured, in UTC; default: now.")] = None,
) -> None:
    """Make a recording of files that other programs left. Prints its path."""
    from station.config import load_config
    from station.foreign_files import ForceSource, MarkerSource, WrongImport, parse_names
    from station.import_trial import import_trial, with_lag
    from station.protocol import TrialSpec

    markers = MarkerSource(mocap, mocap_unit, parse_names(label or ()))
    if force is None or session is None or test is None or (cuff is None) != (test == "bounce"):
        raise WrongImport("an import needs --force, --session, --test and --cuff, a bounce no --cuff; see --help")
    source = ForceSource(force, force_column, force_unit, time_column, sync_column)
    spec = TrialSpec(cuff, test, repeat, donning)
    done = import_trial(session, spec, with_lag(load_config(config), lag_s, lag_sd_s), source, markers, start)
    for note in done.notes:
        say(note)
    print(done.path)
