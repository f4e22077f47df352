"""The verb emg: envelopes, and their shape and change beside the model's activations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from station.exit_code import DONE, LOSSY
from station.verbs.options import print_message


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
    from rich.console import Console

    from station.emg.comparison import ConditionFiles, compare_emg
    from station.emg.emg_json import write_emg
    from station.emg.emg_tables import (
        change_table,
        findings_text,
        pooled_table,
        shape_table,
        write_change,
        write_envelopes,
    )

    condition = ConditionFiles(tuple(trials), tuple(activations or ()))
    compared_with = ConditionFiles(tuple(reference or ()), tuple(reference_activations or ()))
    compared = compare_emg(condition, compared_with, mvc or (), setup)
    files = {
        "emg": condition.emg,
        "activations": condition.activations,
        "reference": compared_with.emg,
        "reference_activations": compared_with.activations,
        "mvc": mvc or (),
        "setup": [setup] if setup else (),
    }
    document = write_emg(output, compared, files)
    written = [*write_envelopes(output, compared, to), write_change(output, compared)]
    for sentence in findings_text(document):
        print_message(sentence)
    for table in (shape_table(document), pooled_table(document), change_table(document)):
        if table.row_count:
            Console(markup=False).print(table)
    for path in filter(None, written):
        print(path)
    raise typer.Exit(LOSSY if any(trial.lost for trial in document.trials) else DONE)
