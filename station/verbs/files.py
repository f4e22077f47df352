"""Verbs on files: info, replay, recover, import, export."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.exit_code import DONE, LOSSY
from station.folders import ensure_folder
from station.verbs.options import (
    Condition,
    ConfigPath,
    Donning,
    FormatOption,
    Repeat,
    Rerun,
    Rrd,
    TestOfPull,
    ensure_not_read,
    ensure_writable,
    print_message,
    print_result,
)

if TYPE_CHECKING:
    from station.files.export_trial import Exported
    from station.files.foreign_files import WrongImport

ExportFormat = Literal["csv", "tsv", "parquet", "trc", "mot", "sto", "c3d", "bids", "foxglove"]


def info(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Show the content of a recording, complete or cut."""
    from station.files.info import show_contents

    raise typer.Exit(show_contents(file, as_json=format == "json"))


def replay(
    file: Annotated[Path, typer.Argument(help="A recording.")],
    session: Annotated[
        Path | None, typer.Option(help="Record it again into this folder; default: keep nothing.")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(min=0.1, help="Largest speed, as a multiple of real time; default: 1, with --rrd alone no limit."),
    ] = None,
    rrd: Rrd = None,
    rerun: Rerun = False,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Replay a recording through recorder, views and writer. Its fit is identical bit for bit."""
    from contextlib import ExitStack
    from tempfile import TemporaryDirectory

    from recordings.reader import open_recording
    from station.bench.live import LiveView
    from station.bench.session_folder import check_folder
    from station.bench.trial_recorder import TrialRefused, View
    from station.checksums import changed_files
    from station.clock import RealClock
    from station.files.timed_replay import replay as play_back

    if session is not None:
        ensure_folder(session)
    for change in changed_files([file]):
        print_message(str(change))
    is_file_alone = rrd is not None and not rerun
    pace = speed or (math.inf if is_file_alone else 1.0)
    with ExitStack() as stack:
        manifest = open_recording(file).manifest
        if session is not None and (refusal := check_folder(session, manifest.devices)):
            raise TrialRefused(refusal)
        folder = session or Path(stack.enter_context(TemporaryDirectory()))
        subject = manifest.cuff
        live = LiveView(RealClock(), file.stem, load_cell=manifest.load_cell, cuff=subject)
        views: list[View] = [stack.enter_context(live)]
        if rrd is None and not rerun:
            result = play_back(file, folder, pace, views)
        else:
            from station.viewer.scene import log_scene
            from station.viewer.viewer import open_rerun

            cord = subject.rope_markers if subject else manifest.body.suit if manifest.body else ()
            logs = open_rerun(stack, rrd, cord, has_viewer=rerun, is_complete=is_file_alone)
            result = play_back(file, folder, pace, [*views, *logs])
            for log in logs:
                log_scene(log.stream, file, log.edge_ns, log.extent)
    print_result(result, format, is_kept=session is not None)
    raise typer.Exit(DONE if result.accepted and not result.lost_samples else LOSSY)


def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut.")],
    output: Annotated[Path | None, typer.Option(help="Default: FILE.recovered.mcap in the same folder.")] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Write a complete file from a recording that was cut. The original is not changed."""
    from station.files.info import recover_recording

    raise typer.Exit(recover_recording(file, output, as_json=format == "json"))


def import_(
    mocap: Annotated[Path, typer.Option(help="Markers: QTM's export as .tsv, or .trc or .c3d.")],
    session: Annotated[Path | None, typer.Option(help="Session folder; created if it does not exist.")] = None,
    cuff: Annotated[str | None, typer.Option(help="Name of the cuff; a bounce has none.")] = None,
    test: Annotated[TestOfPull | None, typer.Option(help="The test.")] = None,
    repeat: Repeat = 1,
    force: Annotated[Path | None, typer.Option(help="Force: a DAQ's .csv with a header, or a .c3d.")] = None,
    config: ConfigPath = Path("station.toml"),
    donning: Donning = "1",
    force_column: Annotated[str | None, typer.Option(help="Default: force_v, force_n or force_lbs.")] = None,
    force_unit: Annotated[
        Literal["V", "N", "lbs"] | None,
        typer.Option(help="Volts are calibrated by the configuration. Default: the file's unit, else V."),
    ] = None,
    time_column: Annotated[str, typer.Option(help="Column of the times [s] in the .csv.")] = "time_s",
    sync_column: Annotated[str, typer.Option(help="Column of the sync line [V], if there is one.")] = "sync_v",
    mocap_unit: Annotated[
        Literal["mm", "cm", "m"] | None, typer.Option(help="Default: the file's unit, else mm.")
    ] = None,
    label: Annotated[list[str] | None, typer.Option(help="THEIRS=OURS renames a marker; may be repeated.")] = None,
    lag_s: Annotated[
        float | None, typer.Option(help="A force sample stamped t was taken at t + LAG_S on the clock of the markers.")
    ] = None,
    lag_sd_s: Annotated[
        float | None,
        typer.Option(min=0, help="Standard uncertainty of the lag [s]; default: 0.0005, larger without a sync line."),
    ] = None,
    start: Annotated[
        datetime | None, typer.Option(help="Time of the capture (UTC); default: the order of the plan.")
    ] = None,
    over: Annotated[Path | None, typer.Option(help="Complete this recording from the export of QTM.")] = None,
) -> None:
    """Convert files of other programs into a recording. Prints its path."""
    from station.checksums import changed_files
    from station.config import load_config
    from station.files.complete_trial import complete_trial
    from station.files.foreign_files import ForceSource, MarkerSource, parse_names
    from station.files.import_trial import import_trial, with_lag
    from station.progress import busy
    from station.protocol import TrialSpec

    markers = MarkerSource(mocap, mocap_unit, parse_names(label or ()))
    command = {"--session": session, "--cuff": cuff, "--test": test, "--force": force}
    if over is not None and not any(command.values()):
        with busy(f"completing {over.name} from {mocap.name}"):
            done = complete_trial(over, markers)
    elif over is not None or force is None or session is None or test is None or (cuff is None) != (test == "bounce"):
        raise _wrong_import(command, is_completion=over is not None)
    else:
        ensure_folder(session)
        source = ForceSource(force, force_column, force_unit, time_column, sync_column)
        spec = TrialSpec(cuff, test, repeat, donning)
        with busy(f"importing {mocap.name}"):
            done = import_trial(session, spec, with_lag(load_config(config), lag_s, lag_sd_s), source, markers, start)
    for note in (*(changed_files([over]) if over is not None else ()), *done.notes):
        print_message(str(note))
    print(done.path)


def export(
    file: Annotated[Path | None, typer.Argument(help="A recording.")] = None,
    session: Annotated[Path | None, typer.Option(help="Export every recording of this session folder.")] = None,
    to: Annotated[ExportFormat | None, typer.Option(help="The format (docs/exchange.md).")] = None,
    output: Annotated[
        Path | None, typer.Option(help="Output folder; default: the folder of the recordings. With --osim: the file.")
    ] = None,
    fill_gaps: Annotated[
        bool, typer.Option("--fill-gaps", help="mot, sto: interpolate linearly where a marker is hidden.")
    ] = False,
    subject: Annotated[str, typer.Option(help="Subject label for BIDS, if the file name has no sub-.")] = "01",
    osim: Annotated[bool, typer.Option("--osim", help="Export a model with the suit for OpenSim.")] = False,
    model: Annotated[str, typer.Option(help='With --osim: an .osim file, or "bundled".')] = "bundled",
    suit: Annotated[Path | None, typer.Option(help="With --osim; default: the bundled exotendon suit.")] = None,
    cuffs: Annotated[Path | None, typer.Option(help="With --osim: a cuffs.json; default: rigid cuffs.")] = None,
    cuff: Annotated[str | None, typer.Option(help="With --osim: the arm cuff, if there are several.")] = None,
    condition: Annotated[
        Condition | None, typer.Option(help="With --osim: effects of the cuffs; default: both.")
    ] = None,
    rest_length_m: Annotated[float | None, typer.Option(min=0, help="With --osim; default: the suit's.")] = None,
    format: FormatOption = "table",  # noqa: A002
) -> None:
    """Write recordings, or a model with the suit, for other programs. Prints the paths of the files."""
    from documents.message import Message, because
    from solver.suit.suit import BUNDLED_SUIT
    from station.assessment.export_model import SuitToExport, write_suited_model
    from station.files.export_trial import Exported
    from station.files.synchronised import WrongExport
    from station.messages.file_messages import ExportCode
    from station.progress import busy

    recordings = {"FILE": file, "--session": session, "--to": to}
    if fill_gaps and to not in ("mot", "sto"):
        raise WrongExport(Message(ExportCode.FILL_GAPS_FORMAT))
    if not osim:
        done = _export_recordings(file, session, to, output, subject, fills_gaps=fill_gaps)
    elif any(recordings.values()):
        figures = {"unused": _names(recordings, are_given=True), "option": "--osim"}
        raise WrongExport(Message(ExportCode.UNUSED_OPTION, figures))
    elif output is None:
        raise WrongExport(Message(ExportCode.INCOMPLETE_MODEL_COMMAND))
    else:
        ensure_writable([output])
        ensure_not_read([output], (model, suit, cuffs))
        with busy("writing the model"):
            suited = SuitToExport(model, suit or BUNDLED_SUIT, cuffs, cuff, condition, rest_length_m)
            remarks = [Message(ExportCode.MODEL_NOTE, because(note)) for note in write_suited_model(suited, output)]
            done = Exported((output,), tuple(remarks), ())
    for message in (*done.notes, *done.refused):
        print_message(str(message))
    if format == "json":
        print(json.dumps(done.to_plain(), indent=2))
    else:
        print("\n".join(map(str, done.paths)))
    raise typer.Exit(DONE if done.is_whole else LOSSY)


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

    from documents.message import Message
    from station.files.export_trial import export_recordings
    from station.files.synchronised import ExportRefused, WrongExport
    from station.messages.file_messages import ExportCode
    from station.progress import busy, progress_bars
    from station.recordings_of_session import originals_in

    if file is not None and session is not None:
        raise WrongExport(Message(ExportCode.UNUSED_OPTION, {"unused": "FILE", "option": "--session"}))
    source = file or session
    if source is None or to is None:
        missing = _names({"FILE or --session": source, "--to": to}, are_given=False)
        raise WrongExport(Message(ExportCode.INCOMPLETE_COMMAND, {"missing": missing}))
    paths = [source] if file is not None else originals_in(source)
    if not paths:
        raise ExportRefused(Message(ExportCode.NO_RECORDING, {"folder": str(source)}))
    folder = output or (source.parent if file is not None else source)
    ensure_folder(folder)
    if len(paths) == 1:
        with busy(f"exporting {paths[0].name}"):
            return export_recordings(paths, to, folder, subject, fills_gaps=fills_gaps)
    with progress_bars(Console(stderr=True)) as progress:
        return export_recordings(paths, to, folder, subject, progress, fills_gaps=fills_gaps)


def _wrong_import(command: Mapping[str, object], *, is_completion: bool) -> WrongImport:
    """The refusal of an import with these options: one is missing, or has no effect."""
    from documents.message import Message
    from station.files.foreign_files import WrongImport
    from station.messages.file_messages import ImportCode

    is_bounce = command["--test"] == "bounce"
    if is_completion:
        figures = {"unused": _names(command, are_given=True), "option": "--over"}
        return WrongImport(Message(ImportCode.UNUSED_OPTION, figures))
    if is_bounce and command["--cuff"] is not None:
        return WrongImport(Message(ImportCode.UNUSED_OPTION, {"unused": "--cuff", "option": "--test bounce"}))
    needed = {name: value for name, value in command.items() if name != "--cuff" or not is_bounce}
    return WrongImport(Message(ImportCode.INCOMPLETE_COMMAND, {"missing": _names(needed, are_given=False)}))


def _names(command: Mapping[str, object], *, are_given: bool) -> str:
    """Those of the options that are on the command line, or those that are not."""
    return ", ".join(name for name, value in command.items() if (value is not None) == are_given)
