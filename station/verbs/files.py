"""With files: info, replay, recover, import, export."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import Condition, ConfigPath, FormatOption, Rerun, Rrd, Speed, Test, print_result, say

if TYPE_CHECKING:
    from station.files.export_trial import Exported

ExportFormat = Literal["csv", "tsv", "parquet", "trc", "mot", "sto", "c3d", "bids", "foxglove"]


def info(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Show what is in a recording, whole or cut."""
    from station.files.info import show_contents

    raise typer.Exit(show_contents(file, as_json=format == "json"))


def replay(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    session: Annotated[
        Path | None, typer.Option(help="Record it anew into this folder; default: keep nothing.")
    ] = None,
    speed: Speed = 1.0,
    rrd: Rrd = None,
    rerun: Rerun = False,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Play a recording back through the live pipeline: daemon, views, writer. The same fit comes out, bit for bit."""
    from contextlib import ExitStack
    from tempfile import TemporaryDirectory

    from recordings.reader import open_recording
    from station.bench.live import LiveView
    from station.bench.session_folder import why_not_here
    from station.bench.trial_recorder import TrialRefused, View
    from station.checksums import changed_files
    from station.clock import RealClock
    from station.files.replay import replay as play_back

    for sentence in changed_files([file]):
        say(sentence)
    with ExitStack() as stack:
        manifest = open_recording(file).manifest
        if session is not None and (why_not := why_not_here(session, manifest.devices)):
            raise TrialRefused(why_not)
        folder = session or Path(stack.enter_context(TemporaryDirectory()))
        subject = manifest.cuff
        live = LiveView(RealClock(), file.stem, load_cell=manifest.load_cell, cuff=subject)
        views: list[View] = [stack.enter_context(live)]
        if rrd is None and not rerun:
            result = play_back(file, folder, speed, views)
        else:
            from station.viewer.log import open_rerun
            from station.viewer.scene import log_scene

            logs = open_rerun(stack, rrd, subject.rope_markers if subject else (), has_viewer=rerun)
            result = play_back(file, folder, speed, [*views, *logs])
            for log in logs:
                log_scene(log.stream, file, log.edge_ns, log.framed)
    print_result(result, format, is_kept=session is not None)
    raise typer.Exit(DONE if result.accepted and not result.lost_samples else LOSSY)


def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut.")],
    output: Annotated[Path | None, typer.Option(help="Where to; default: FILE.recovered.mcap beside it.")] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Make a whole file of what a killed recording left. Never touches the original."""
    from station.files.info import recover_recording

    raise typer.Exit(recover_recording(file, output, as_json=format == "json"))


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
        Literal["mm", "cm", "m"] | None, typer.Option(help="Default: what the file says, else mm.")
    ] = None,
    label: Annotated[list[str] | None, typer.Option(help="THEIRS=OURS renames a marker; may be repeated.")] = None,
    lag_s: Annotated[
        float | None, typer.Option(help="A force sample stamped t was taken at t + LAG_S by the markers' time.")
    ] = None,
    lag_sd_s: Annotated[
        float | None,
        typer.Option(min=0, help="Its standard uncertainty. Default: 0.0005; without a sync line half a sample more."),
    ] = None,
    start: Annotated[
        datetime | None, typer.Option(help="When it was captured, in UTC; default: in the order of the plan.")
    ] = None,
    over: Annotated[Path | None, typer.Option(help="Instead: a recording of the station, to be completed.")] = None,
) -> None:
    """Make a recording of files that other programs left. Prints its path."""
    from station.checksums import changed_files
    from station.config import load_config
    from station.files.complete_trial import complete_trial
    from station.files.foreign_files import ForceSource, MarkerSource, WrongImport, parse_names
    from station.files.import_trial import import_trial, with_lag
    from station.progress import busy
    from station.protocol import TrialSpec

    markers = MarkerSource(mocap, mocap_unit, parse_names(label or ()))
    if over is not None and force is None:
        with busy(f"laying {mocap.name} over {over.name}"):
            done = complete_trial(over, markers)
    elif over is not None or force is None or session is None or test is None or (cuff is None) != (test == "bounce"):
        raise WrongImport(
            "an import needs --force, --session, --test and --cuff (a bounce no --cuff), or --over alone; see --help"
        )
    else:
        source = ForceSource(force, force_column, force_unit, time_column, sync_column)
        spec = TrialSpec(cuff, test, repeat, donning)
        with busy(f"importing {mocap.name}"):
            done = import_trial(session, spec, with_lag(load_config(config), lag_s, lag_sd_s), source, markers, start)
    for note in (*(changed_files([over]) if over is not None else ()), *done.notes):
        say(note)
    print(done.path)


def export(
    file: Annotated[Path | None, typer.Argument(help="A recording.")] = None,
    session: Annotated[Path | None, typer.Option(help="Instead: every recording of a session.")] = None,
    to: Annotated[ExportFormat | None, typer.Option(help="The format; docs/exchange.md says what is in each.")] = None,
    output: Annotated[
        Path | None, typer.Option(help="Folder to write into; default: the recordings' own. With --osim: the file.")
    ] = None,
    fill_gaps: Annotated[
        bool, typer.Option("--fill-gaps", help="mot, sto: fill where a marker is hidden, along straight lines.")
    ] = False,
    subject: Annotated[str, typer.Option(help="For BIDS, where the recording's name has no sub-.")] = "01",
    osim: Annotated[bool, typer.Option("--osim", help="Instead: a model that wears the suit, for OpenSim.")] = False,
    model: Annotated[str, typer.Option(help='With --osim: an .osim file, or "bundled".')] = "bundled",
    suit: Annotated[Path | None, typer.Option(help="With --osim; default: the bundled exotendon suit.")] = None,
    cuffs: Annotated[Path | None, typer.Option(help="With --osim: a cuffs.json; default: rigid cuffs.")] = None,
    cuff: Annotated[str | None, typer.Option(help="With --osim: the arm cuff, where there are several.")] = None,
    condition: Annotated[Condition | None, typer.Option(help="With --osim: what the cuffs do; default: both.")] = None,
    rest_length_m: Annotated[float | None, typer.Option(min=0, help="With --osim; default: the suit's.")] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Write recordings, or a suited model, for other programs. Prints the paths of what it wrote."""
    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.export_model import SuitToExport, write_suited_model
    from station.files.export_trial import Exported
    from station.files.one_clock import WrongExport
    from station.progress import busy

    if fill_gaps and to not in ("mot", "sto"):
        raise WrongExport("--fill-gaps is for --to mot and --to sto; the other formats mark what is missing")
    if not osim:
        done = _export_recordings(file, session, to, output, subject, fills_gaps=fill_gaps)
    elif output is None or file is not None or session is not None or to is not None:
        raise WrongExport("an export with --osim needs --output, and no FILE, --session or --to; see --help")
    else:
        with busy("writing the model"):
            suited = SuitToExport(model, suit or BUNDLED_SUIT, cuffs, cuff, condition, rest_length_m)
            done = Exported((output,), tuple(write_suited_model(suited, output)), ())
    for sentence in (*done.notes, *done.refused):
        say(sentence)
    if format == "json":
        content = {"written": [str(path) for path in done.paths], "notes": done.notes, "refused": done.refused}
        print(json.dumps(content, indent=2))
    else:
        print("\n".join(map(str, done.paths)))
    raise typer.Exit(LOSSY if done.refused else DONE)


def _export_recordings(
    file: Path | None,
    session: Path | None,
    to: ExportFormat | None,
    output: Path | None,
    subject: str,
    *,
    fills_gaps: bool,
) -> Exported:
    from rich.console import Console

    from station.files.export_trial import export_recordings
    from station.files.one_clock import ExportRefused, WrongExport
    from station.fit import originals_in
    from station.progress import busy, progress_bars

    source = file or session
    if source is None or (file is not None and session is not None) or to is None:
        raise WrongExport("an export needs either a FILE or --session, and --to, or else --osim; see --help")
    paths = [source] if file is not None else originals_in(source)
    if not paths:
        raise ExportRefused(f"{source} holds no recording (*.mcap); give the folder of a session")
    where = output or (source.parent if file is not None else source)
    if len(paths) == 1:
        with busy(f"exporting {paths[0].name}"):
            return export_recordings(paths, to, where, subject, fills_gaps=fills_gaps)
    with progress_bars(Console(stderr=True)) as progress:
        return export_recordings(paths, to, where, subject, progress, fills_gaps=fills_gaps)
