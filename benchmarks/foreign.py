"""Files of other programs: which are accepted, and whether their values are those of an independent reader.

    python -m benchmarks.foreign FOLDER…

Every .c3d and .trc below the folders is read by the station's reader and by another one: C3D by the package c3d, and by
ezc3d where the two differ or c3d fails; TRC by OpenSim (extra `oracle`). Each other reader runs in a process with
limits of memory and time, because some files end it. Compared are the labels, times, positions and missing markers, and
of C3D all analog channels. A line is printed for every file that is not read as by the others, then the counts:
accepted right and wrong, refused right (no other reader finds markers) and wrong, and accepted alone (no other opens
the file).
"""

import hashlib
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.command_line import parse_options
from recordings.errors import ForeignFile
from recordings.exchange.c3d import read_c3d_markers, read_c3d_signals
from recordings.exchange.trc import read_trc

Array = NDArray[np.float64]
MOST_BYTES, LONGEST_S = 4 * 2**30, 120.0
"""Of the process of another reader."""
POSITION_MM, RATE, RELATIVE = 1e-3, 1e-4, 1e-5
"""Largest differences: of a position, of a rate over the rate, and of positions and signals over the largest value."""
MILLIMETRES = {"m": 1000.0, "cm": 10.0, "mm": 1.0, "mete": 1000.0, "metr": 1000.0}


@dataclass(frozen=True)
class Content:
    """Rate [Hz]; positions (frames, labels, 3) in the file's unit, NaN if missing; signals name → (samples,)."""

    labels: tuple[str, ...]
    rate: float
    positions: Array
    signals: dict[str, Array]
    unit: str = ""


def main() -> None:
    counts: dict[str, Counter[str]] = {".c3d": Counter(), ".trc": Counter()}
    for path in distinct_files(parse_options(__doc__, paths="+").paths, (".c3d", ".trc")):
        verdict, reason = judge(path)
        counts[path.suffix.lower()][verdict] += 1
        if verdict != "accepted right":
            print(f"{verdict:<22}{path}: {reason}", flush=True)
    verdicts = ("accepted right", "accepted wrong", "refused right", "refused wrong", "accepted alone")
    print(f"\n{'':<6}" + "".join(f"{verdict:>16}" for verdict in verdicts))
    for suffix, found in counts.items():
        print(f"{suffix:<6}" + "".join(f"{found[verdict]:>16}" for verdict in verdicts))


def distinct_files(folders: Sequence[Path], suffixes: Sequence[str]) -> Iterator[Path]:
    """The files with one of the suffixes in alphabetical order, each content once."""
    seen = set()
    for path in sorted(path for folder in folders for path in folder.rglob("*")):
        if path.suffix.lower() in suffixes and path.is_file():
            content = hashlib.sha256(path.read_bytes()).digest()
            if content not in seen:
                seen.add(content)
                yield path


def read_apart(reader: Callable[[Path], Content], path: Path) -> Content | str:
    """Content that another reader finds in a process of its own, or why it finds nothing."""
    pool = ProcessPoolExecutor(1, get_context("spawn"), initializer=_limit)
    try:
        return pool.submit(reader, path).result(LONGEST_S)
    except BrokenProcessPool:
        return "ended its process"
    except TimeoutError:
        for process in list(pool._processes.values()):
            process.kill()
        return f"took more than {LONGEST_S:g} s"
    except Exception as error:  # whatever its code raises
        return f"{type(error).__name__}: {str(error)[:100]}"
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def judge(path: Path) -> tuple[str, str]:
    """One of the verdicts, and its reason."""
    is_c3d = path.suffix.lower() == ".c3d"
    ours: Content | str
    try:
        ours = our_c3d(path) if is_c3d else our_trc(path)
    except ForeignFile as error:
        ours = f"[{error.code}] {error}"
    reasons, is_compared = [], False
    for reader in (c3d_package, ezc3d_package) if is_c3d else (opensim_table,):
        theirs = read_apart(reader, path)
        if isinstance(theirs, str) or not theirs.labels:
            reasons.append(f"{reader.__name__} {theirs if isinstance(theirs, str) else 'finds no labels'}")
            continue
        if isinstance(ours, str):
            return "refused wrong", f"{ours}; {reader.__name__} finds {len(theirs.labels)} markers"
        difference = next(differences(ours, theirs), "")
        if not difference:
            return "accepted right", ""
        reasons.append(f"{reader.__name__}: {difference}")
        is_compared = True
    if isinstance(ours, str):
        return "refused right", "; ".join((ours, *reasons))
    return ("accepted wrong" if is_compared else "accepted alone"), "; ".join(reasons)


def differences(ours: Content, theirs: Content) -> Iterator[str]:
    """The first of them matters. Our readers number repeated labels, and have millimetres."""
    mine, named = (
        [i for i, label in enumerate(labels) if label and label[0] != "*"] for labels in (ours.labels, theirs.labels)
    )
    if [_base(ours.labels[i]) for i in mine] != [_base(theirs.labels[i]) for i in named]:
        yield f"labels {ours.labels[:3]}… ({len(mine)}), {theirs.labels[:3]}… ({len(named)})"
        return
    if abs(ours.rate / theirs.rate - 1) > RATE:
        yield f"{ours.rate} Hz, {theirs.rate} Hz"
    positions = MILLIMETRES.get(theirs.unit.lower()[:4], 1.0) * theirs.positions[:, named]
    found = ours.positions[:, mine]
    if positions.shape != found.shape:
        yield f"{found.shape} positions, {positions.shape}"
        return
    is_missing = np.isnan(positions).any(axis=2) | (positions == 0).all(axis=2)
    if (is_missing != np.isnan(found[..., 0])).any():
        yield f"{int(np.isnan(found[..., 0]).sum())} missing positions, {int(is_missing.sum())}"
    worst = np.abs(found - positions)[~is_missing].max(initial=0.0)
    if worst > max(POSITION_MM, RELATIVE * np.abs(positions[~is_missing]).max(initial=0.0)):
        yield f"positions differ by {worst:.3g} mm"
    for name, values in ours.signals.items():
        other = theirs.signals[name]
        worst = np.abs(values - other).max(initial=0.0) if len(values) == len(other) else np.inf
        if worst > RELATIVE * max(1.0, np.abs(other).max(initial=0.0)):
            yield f"{name} differs by {worst:.3g} ({values[0]:.6g}, {other[0]:.6g} …)"


def _base(label: str) -> str:
    return label.partition("#")[0].strip()


def our_c3d(path: Path) -> Content:
    table = read_c3d_markers(path)
    names: Sequence[str] = ()
    with suppress(ForeignFile):
        names = read_c3d_signals(path, ()).names
    single = [name for name in names if names.count(name) == 1]
    signals = read_c3d_signals(path, single).signals if single else {}
    return Content(table.labels, table.rate_hz, table.positions, dict(signals))


def our_trc(path: Path) -> Content:
    table = read_trc(path)
    return Content(table.labels, (len(table.time_s) - 1) / np.ptp(table.time_s), table.positions, {})


def c3d_package(path: Path) -> Content:
    import c3d

    warnings.simplefilter("ignore")
    points, analog = [], []
    with path.open("rb") as file:
        reader = c3d.Reader(file)
        for _, point, channels in reader.read_frames():
            points.append(point)
            analog.append(channels)
        names = [name.strip() for name in reader.analog_labels] if reader.analog_used else []
        unit = reader.get("POINT:UNITS")
        labels = tuple(label.strip() for label in reader.point_labels[: reader.point_used])
        values = np.array(points, float)
        positions = np.where(values[..., 3:4] < 0, np.nan, values[..., :3])[:, : len(labels)]
        rate = float(reader.point_rate)
    samples = np.concatenate(analog, axis=1) if names else np.zeros((0, 0))
    name = unit.string_value.strip() if unit else ""
    return Content(labels, rate, positions, dict(zip(names, samples, strict=False)), name)


def ezc3d_package(path: Path) -> Content:
    import ezc3d

    file = ezc3d.c3d(str(path))
    point, analog = file["parameters"]["POINT"], file["parameters"].get("ANALOG", {})
    labels = [label.strip() for name in ("LABELS", "LABELS2") for label in point.get(name, {}).get("value", [])]
    values = np.moveaxis(file["data"]["points"][:3], 0, 2).transpose(1, 0, 2)
    missing = file["data"]["meta_points"]["residuals"][0].T < 0
    positions = np.where(missing[..., None], np.nan, values)[:, : len(labels)]
    names = [name.strip() for name in analog.get("LABELS", {}).get("value", [])]
    signals = dict(zip(names, file["data"]["analogs"][0], strict=False))
    unit = next(iter(point.get("UNITS", {}).get("value", [])), "")
    shown = tuple(labels[: positions.shape[1]])
    return Content(shown, float(point["RATE"]["value"][0]), positions, signals, unit.strip())


def opensim_table(path: Path) -> Content:
    import opensim

    opensim.Logger.setLevelString("off")
    table = opensim.TimeSeriesTableVec3(str(path))
    rows = map(table.getRowAtIndex, range(table.getNumRows()))
    positions = np.array([[row[k].to_numpy() for k in range(table.getNumColumns())] for row in rows])
    time = np.array(table.getIndependentColumn())
    unit = table.getTableMetaDataString("Units")
    return Content(tuple(table.getColumnLabels()), (len(time) - 1) / np.ptp(time), positions, {}, unit)


def _limit() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    main()
