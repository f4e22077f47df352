"""PNG of matplotlib's figures: always the same, opaque, of the size that was asked for."""

from __future__ import annotations

import io

from matplotlib.figure import Figure
from PIL import Image

from station.report.canvas import DPI, as_png


def test_the_same_figure_gives_the_same_bytes_without_a_date_or_a_version() -> None:
    first, second = (as_png(_example()) for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert set(image.info) == {"dpi"}


def test_a_figure_is_opaque_and_as_large_as_it_was_asked_to_be() -> None:
    with Image.open(io.BytesIO(as_png(_example()))) as image:
        assert image.mode == "RGB"
        assert image.size == (3 * DPI, 2 * DPI)
        assert image.getpixel((0, 0)) == (255, 255, 255)


def _example() -> Figure:
    figure = Figure(figsize=(3.0, 2.0))
    figure.subplots().plot([0.0, 61.0], [-0.77, 2e6])
    return figure
