"""A lab's EMG: two channels that follow two muscles of a model, in repeats, with maximum voluntary contractions."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.signal_csv import write_columns
from tests.fitting.emg.simulated import RATE, activation, raw_emg

Array = NDArray[np.float64]
TIME = np.arange(0, 8, 1 / RATE)
FULL_MV = 0.5
"""Of a channel's raw EMG, its standard deviation at full activation."""
SETUP = """
[channels]
delt_ant = { muscles = ["DeltoideusClavicle_A"] }
serratus = { muscles = ["SerratusAnterior_I", "SerratusAnterior_M"], weights = [1, 3] }
"""


def write_emg(
    path: Path, levels: Array, seed: int, titles: tuple[str, str] = ("delt_ant [mV]", "serratus [mV]")
) -> Path:
    """Raw EMG of the levels (n, 2) at RATE, as fractions of full activation."""
    random = np.random.default_rng(seed)
    raw = [FULL_MV * raw_emg(level, random)[:, 0] for level in levels.T]
    path.write_text(write_columns({"time_s": TIME[: len(levels)], **dict(zip(titles, raw, strict=True))}, ","))
    return path


def levels(scale: float = 1.0, lag: float = 0.05) -> Array:
    """(n, 2): both muscles of a raise, the second later and smaller; lag [s] behind the model."""
    return scale * np.column_stack((activation(TIME - lag), 0.5 * activation(TIME - lag, peak=4.0)))


def write_activations(path: Path, scale: float = 1.0, start: float = 0.0) -> Path:
    """The model's, at 100 Hz: the serratus' middle part three times as active as its lower one."""
    time = np.arange(0, 8, 0.01)
    late = scale * 0.5 * activation(time, peak=4.0)
    columns = {"time": start + time, "DeltoideusClavicle_A": scale * activation(time)}
    columns |= {"SerratusAnterior_M": 1.2 * late, "SerratusAnterior_I": 0.4 * late, "BIC_long": 0.1 * late}
    path.write_text(write_columns(columns, ","))
    return path


def write_mvc(path: Path) -> Path:
    """Both channels at full activation for two seconds, one after the other."""
    hold = np.where((TIME > 1) & (TIME < 3), 1.0, 0.01)
    return write_emg(path, np.column_stack((hold, np.roll(hold, 4000))), seed=90)


def write_setup(path: Path, text: str = SETUP) -> Path:
    path.write_text(text, encoding="utf-8")
    return path
