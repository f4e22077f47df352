"""The public trial (Seth et al. 2019) beside the published activations (Belli et al. 2023), against SciPy alone."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from fitting.emg.channels import ChannelFinding
from fitting.emg.shape import ShapeOutcome
from station.emg.comparison import ConditionFiles, compare_emg
from tests.conftest import SHARED

pytestmark = pytest.mark.shared

PUBLISHED_MAXIMA = {"MD": 0.706, "SA": 1.862}
"""By which the authors divide their EMG, in its unknown unit."""
SETUP = '[envelope]\nmethod = "seth_2019"\n[channels]\n' + "".join(
    f"{label} = {{ muscles = {muscles}, maximum = {PUBLISHED_MAXIMA[label]} }}\n"
    for label, muscles in (
        ("MD", ["DeltoideusScapula_M"]),
        ("SA", ["SerratusAnterior_I", "SerratusAnterior_M", "SerratusAnterior_S"]),
    )
)


def test_level_and_correlation_are_those_of_the_published_processing(tmp_path: Path) -> None:
    """Divided by the maximum, high-pass forwards, rectified, low-pass forwards and backwards; then Pearson's r."""
    path, setup = tmp_path / "FLX01.exp", tmp_path / "emg.toml"
    path.write_bytes(gzip.decompress((SHARED / "markers" / "FLX01_emg.exp.gz").read_bytes()))
    setup.write_text(SETUP, encoding="utf-8")
    activations = SHARED / "published" / "FLX01_gh.csv"
    compared = compare_emg(ConditionFiles((path,), (activations,)), ConditionFiles(()), (), setup).trials[0]

    raw, model = np.genfromtxt(path, skip_header=9), np.genfromtxt(activations, delimiter=",", names=True)
    columns = {"MD": (2, ["DeltoideusScapula_M"]), "SA": (8, [f"SerratusAnterior_{part}" for part in "IMS"])}
    for label, (column, muscles) in columns.items():
        high = signal.lfilter(*signal.butter(4, 100 / 500, "high"), raw[:, column] / PUBLISHED_MAXIMA[label])
        envelope = signal.filtfilt(*signal.butter(2, 2.5 / 500), np.abs(high), padlen=6)
        np.testing.assert_allclose(compared.levels.of(label), np.maximum(envelope, 0), rtol=1e-7, atol=1e-12)
        inner = slice(50, -50)
        activation = np.mean([model[muscle] for muscle in muscles], axis=0)
        r = np.corrcoef(np.interp(model["time"], raw[:, 0] / 1000, envelope)[inner], activation[inner])[0, 1]
        found = compared.comparisons[label]
        assert found.outcome is ShapeOutcome.LAG_NOT_IDENTIFIED
        assert found.correlation == pytest.approx(r, abs=0.02)  # ours smooths the model, too, and at fewer samples
        assert found.correlation_ci95[0] < r < found.correlation_ci95[1]
    assert compared.levels.of("MD").max() == pytest.approx(0.43, abs=0.01)
    assert compared.envelopes.findings["Infra"] == (ChannelFinding.HUM,)
    assert ChannelFinding.NO_MVC in compared.levels.findings["AD"]
