"""The verb emg: envelopes, and their shape and change beside the model's activations."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import ensure_not_read, print_message

if TYPE_CHECKING:
    from station.emg.emg_json import EmgDocument


def emg(
    trials: Annotated[
        list[Path], typer.Argument(help="EMG of the repeats of a condition: .exp, .csv, .tsv, .txt, .c3d, .mcap.")
    ],
    output: Annotated[Path, typer.Option(help="Folder for the envelopes, emg.json and emg_change.csv.")],
    activations: Annotated[
        list[Path] | None,
        typer.Option(help="Activations of the model, one file per trial in order: .sto or .csv of `station rmr`."),
    ] = None,
    reference: Annotated[
        list[Path] | None,
        typer.Option(help="EMG of the reference condition, such as without the suit; may be repeated."),
    ] = None,
    reference_activations: Annotated[
        list[Path] | None, typer.Option(help="Activations of the model, one file per reference.")
    ] = None,
    mvc: Annotated[
        list[Path] | None, typer.Option(help="EMG of maximum voluntary contractions; may be repeated.")
    ] = None,
    setup: Annotated[
        Path | None, typer.Option(help="Filters, and the muscles of every channel: .toml. Default: docs/emg.md.")
    ] = None,
    to: Annotated[Literal["sto", "csv"], typer.Option(help="Format of the envelopes.")] = "sto",
) -> None:
    """Compute EMG envelopes, normalised to a known MVC, and compare shape and change with the model's activations."""
    from station.emg.comparison import ConditionFiles, compare_emg
    from station.emg.emg_json import write_emg
    from station.emg.emg_tables import result_files, write_change, write_envelopes
    from station.output_folder import ensure_folder

    condition = ConditionFiles(tuple(trials), tuple(activations or ()))
    compared_with = ConditionFiles(tuple(reference or ()), tuple(reference_activations or ()))
    files = {
        "emg": condition.emg,
        "activations": activations or (),
        "reference": compared_with.emg,
        "reference_activations": reference_activations or (),
        "mvc": mvc or (),
        "setup": [setup] if setup else (),
    }
    ensure_folder(output)
    ensure_not_read(result_files(output, (*condition.emg, *compared_with.emg), to), chain.from_iterable(files.values()))
    compared = compare_emg(condition, compared_with, mvc or (), setup)
    document = write_emg(output, compared, files)
    written = [*write_envelopes(output, compared, to), write_change(output, compared)]
    _print_results(document)
    for path in filter(None, written):
        print(path)
    raise typer.Exit(DONE if all(trial.is_whole for trial in document.trials) else LOSSY)


def _print_results(document: EmgDocument) -> None:
    """Print tables to stdout and findings to stderr."""
    from rich.console import Console

    from station.emg.emg_tables import change_table, findings_text, pooled_table, shape_table

    for sentence in findings_text(document):
        print_message(sentence)
    for table in (shape_table(document), pooled_table(document), change_table(document)):
        if table.row_count:
            Console(markup=False).print(table)
