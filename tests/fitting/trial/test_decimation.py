"""What is kept of a recording says the same of its clocks and rates as all of it, however it came in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fitting.trial.decimation import Decimator, decimate, highest_rate
from fitting.trial.sync_certificate import certify
from fitting.trial.timeline import align_by_sync_edge
from recordings.manifest import Manifest
from recordings.reader import Track
from recordings.samples import Samples
from tests.fitting.experiment import Session, published

Tracks = dict[str, Track]


@cache
def _dynamic() -> tuple[Manifest, Tracks]:
    return Session(published("hand", clock_ppm=80e-6, occlusion=0.02), 5).dynamic()


def _blocks(track: Track, sizes: list[int]) -> Iterator[Samples]:
    first = 0
    while first < len(track.sample_numbers):
        last = first + sizes[first % len(sizes)]
        part = slice(first, last)
        host_ns = int(track.host_time_ns[part][-1])
        yield Samples(
            track.stream.name, track.sample_numbers[part], track.device_time_ns[part], host_ns, track.values[part]
        )
        first = last


def _hosts_by_block(track: Track, sizes: list[int]) -> Track:
    hosts = [np.full(len(block.sample_numbers), block.host_time_ns) for block in _blocks(track, sizes)]
    return replace(track, host_time_ns=np.concatenate(hosts))


@pytest.mark.parametrize("sizes", [[50], [1, 7, 23], [1000]])
def test_block_by_block_or_as_a_whole_the_same_rows_are_kept(sizes: list[int]) -> None:
    manifest, tracks = _dynamic()
    tracks = {name: _hosts_by_block(track, sizes) for name, track in tracks.items()}
    decimator = Decimator(manifest, [track.stream for track in tracks.values()])
    for track in tracks.values():
        for block in _blocks(track, sizes):
            decimator.take(block)
    kept = decimator.tracks()
    for name, whole in decimate(manifest, tracks).items():
        np.testing.assert_array_equal(kept[name].sample_numbers, whole.sample_numbers)
        np.testing.assert_array_equal(kept[name].device_time_ns, whole.device_time_ns)
        np.testing.assert_array_equal(kept[name].host_time_ns, whole.host_time_ns)
        np.testing.assert_allclose(kept[name].values, whole.values, rtol=1e-12)
    assert certify(manifest, kept) == certify(manifest, decimate(manifest, tracks))


def test_what_is_kept_grows_by_twenty_rows_a_second_and_ties_the_clocks_as_all_of_it_does() -> None:
    manifest, tracks = _dynamic()
    decimated = decimate(manifest, tracks)
    seconds = len(tracks["/force"].sample_numbers) / 1000
    assert len(decimated["/force"].sample_numbers) == pytest.approx(20 * seconds, abs=2)
    assert len(decimated["/markers"].sample_numbers) <= 20 * seconds
    assert len(decimated["/sync"].sample_numbers) <= 10
    whole, kept = align_by_sync_edge(manifest, tracks), align_by_sync_edge(manifest, decimated)
    assert (kept.clock.start, kept.clock.ratio) == (whole.clock.start, whole.clock.ratio)
    assert kept.sync_fall == whole.sync_fall and kept.sync_findings == whole.sync_findings
    assert kept.edge_sd == pytest.approx(whole.edge_sd, rel=1e-3)


def test_the_highest_rate_passes_over_gaps_and_rows_that_are_not_full() -> None:
    numbers = np.arange(49, 1000, 50)  # rows of 50 samples at 1 kHz, named by their last one
    means = np.column_stack((3.0 * numbers, 4.0 * numbers)) * 1e-3
    means[5] = np.nan
    numbers[10:] += 50
    means[10:] += 100.0
    assert highest_rate(numbers, means, 1000.0) == pytest.approx(5.0)
    assert highest_rate(numbers[:1], means[:1], 1000.0) == 0.0


def test_force_of_ten_lines_a_second_has_a_rate_too() -> None:
    assert highest_rate(np.arange(5), np.array([[0.0], [1.0], [3.0], [3.0], [3.0]]), 10.0) == pytest.approx(20.0)
