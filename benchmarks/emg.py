"""EMG of the public trials beside the published activations: `python -m benchmarks.emg [--method seth_2019]`.

Needs the public data set beside the repository. Trials, files and their licence are described there.
"""

from __future__ import annotations

import argparse
import gzip
import tempfile
from pathlib import Path

from rich.console import Console

from station.emg.comparison import ConditionFiles, compare_emg
from station.emg.emg_json import write_emg
from station.emg.emg_tables import findings_text, shape_table

DATA = Path(__file__).parents[1].parent / "shared" / "data"
TRIALS = ("FLX01", "ABD02", "SHRUG01")
LABELS = ("AD", "MD", "PD", "TS", "TM", "TI", "Infra", "SA", "LatD", "PM_Sternal", "PM_Clav", "TMajor", "Bic", "Tric")
SETUP = """
[file]
rate_hz = 1000.0
labels = {labels}
[envelope]
method = "{method}"
"""
"""One of the files has no header; its columns are those of the others."""


def main(method: str) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        setup = folder / "setup.toml"
        setup.write_text(SETUP.format(labels=list(LABELS), method=method), encoding="utf-8")
        for trial in TRIALS:
            (folder / f"{trial}.exp").write_bytes(
                gzip.decompress((DATA / "markers" / f"{trial}_emg.exp.gz").read_bytes())
            )
        emg = tuple(folder / f"{trial}.exp" for trial in TRIALS)
        activations = tuple(DATA / "published" / f"{trial}_gh.csv" for trial in TRIALS)
        compared = compare_emg(ConditionFiles(emg, activations), ConditionFiles(()), (), setup)
        document = write_emg(folder, compared, {"emg": emg})
    console = Console(markup=False)
    console.print(shape_table(document))
    for sentence in findings_text(document):
        console.print(sentence)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", default="linear_envelope", choices=("linear_envelope", "rms", "seth_2019"))
    main(parser.parse_args().method)
