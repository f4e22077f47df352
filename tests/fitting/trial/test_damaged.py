"""Damaged recordings: whatever happened to the tracks, the fit says so in a sentence and never in a traceback."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fitting.cuffs.cuffs_json import cuffs_json
from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from recordings.manifest import Manifest
from recordings.reader import Track
from tests.fitting.experiment import Session, published

Tracks = dict[str, Track]
FATES = {"used", "unusable", *RejectionCode}


@cache
def _recorded() -> tuple[tuple[Manifest, Tracks], ...]:
    """A short static and a short dynamic trial, force at 100 Hz."""
    truth = published("elbow", force_rate=100.0, hold=4.0, weights=(20.0, 40.0), duration=9.0)
    session = Session(truth, 7)
    return session.static(), session.dynamic()


def _keep(track: Track, index: np.ndarray) -> Track:
    parts = (track.sample_numbers, track.device_time_ns, track.host_time_ns, track.values)
    return Track(track.stream, *(part[index] for part in parts))


def _damage(track: Track, kind: str, first: float, last: float) -> Track:
    """One damage to the stretch between two fractions of the track."""
    n = len(track.sample_numbers)
    part = slice(int(first * n), int(last * n))
    inside = np.zeros(n, bool)
    inside[part] = True
    if kind == "lost":
        return _keep(track, np.flatnonzero(~inside))
    if kind == "only":
        return _keep(track, np.flatnonzero(inside))
    changed = {
        name: getattr(track, name).copy() for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")
    }
    if kind in ("nan", "zero", "huge"):
        changed["values"][part] = {"nan": math.nan, "zero": 0.0, "huge": 1e6}[kind]
    elif kind == "stuck":
        changed["values"][part] = changed["values"][part.start : part.start + 1]
    elif kind == "renumbered":
        changed["sample_numbers"][part.stop :] += np.uint64(500)
    elif kind == "late":
        changed["host_time_ns"][part] += 5_000_000_000
    elif kind == "stamps":
        changed["device_time_ns"][part] = 0
    return replace(track, **changed)


KINDS = ("lost", "only", "nan", "zero", "huge", "stuck", "renumbered", "late", "stamps")
fractions = st.tuples(st.floats(0, 1), st.floats(0, 1)).map(sorted)
damages = st.lists(
    st.tuples(st.integers(0, 1), st.sampled_from(["/force", "/sync", "/markers"]), st.sampled_from(KINDS), fractions),
    max_size=3,
)


def _found(*damages: tuple[int, str, str, list[float]]) -> Any:
    """One that a random search found to be neither fitted nor refused."""
    return example(list(damages))


@_found(
    (1, "/markers", "lost", [0.0135, 0.85]),
    (0, "/sync", "stuck", [0.0116, 0.708]),
    (1, "/markers", "huge", [0.5747, 0.9585]),
)
@_found((0, "/markers", "lost", [0.875, 0.999]))
@_found((0, "/markers", "stuck", [0.02, 1.0]), (0, "/force", "only", [0.3422, 0.771]))
@_found((0, "/force", "lost", [0.00791, 0.04217]), (1, "/markers", "stuck", [0.35038, 1.0]))
@_found(
    (1, "/sync", "zero", [0.00294, 0.28687]),
    (1, "/markers", "stuck", [0.31218, 0.92625]),
    (0, "/markers", "huge", [0.29563, 0.97075]),
    (0, "/force", "zero", [0.0335, 1.0]),
)
@_found(
    (0, "/markers", "stamps", [0.0, 0.51796]),
    (0, "/sync", "lost", [0.96352, 1.0]),
    (0, "/force", "renumbered", [0.5727, 0.99122]),
    (0, "/markers", "only", [0.75122, 0.75306]),
)
@_found(
    (0, "/markers", "only", [0.70733, 1.0]),
    (1, "/markers", "late", [0.0, 0.95667]),
    (0, "/force", "lost", [0.0412, 0.99312]),
)
@_found((1, "/sync", "zero", [0.62233664, 1.0]), (0, "/force", "late", [0.9452918, 0.99568963]))
@settings(max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(damages)
def test_damaged_tracks_are_fitted_or_refused_in_a_sentence(damages: list[tuple[int, str, str, list[float]]]) -> None:
    assert _fates(damages) <= FATES


@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(damages)
def test_many_damaged_tracks_are_fitted_or_refused_in_a_sentence(
    damages: list[tuple[int, str, str, list[float]]],
) -> None:
    assert _fates(damages) <= FATES


def _fates(damages: list[tuple[int, str, str, list[float]]]) -> set[str]:
    """Of each trial the state in cuffs.json, or the code of its refusal; "NaN" or "Infinity" if the file has one."""
    tracks = [dict(tracks) for _, tracks in _recorded()]
    for trial, name, kind, (first, last) in damages:
        tracks[trial][name] = _damage(tracks[trial][name], kind, first, last)
    trials, fates = [], []
    for i, (manifest, _) in enumerate(_recorded()):
        try:
            trials.append(build_trial(manifest, tracks[i], f"{i}.mcap", "hash"))
        except UnusableTrial as error:
            fates.append(error.code)
    document = json.loads(cuffs_json(fit_session(trials)), parse_constant=fates.append)
    listed = [trial for cuff in document["cuffs"].values() for trial in cuff["trials"]]
    written = {trial["file"]: trial["state"] for trial in listed}
    rejected = {trial["file"]: trial["reason_code"]["code"] for trial in document["rejected"]}
    return {*fates, *((written | rejected)[trial.file] for trial in trials)}
