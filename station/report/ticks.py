"""Ticks of the report's figures, drawn at a fraction of their usual cost."""

from __future__ import annotations

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis, YAxis
from matplotlib.backend_bases import RendererBase
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator


class MovedTick(Artist):
    """All ticks of an axis with their labels and grid lines, drawn by one Tick that moves from place to place.

    Matplotlib builds a Tick for every place, of five artists each, which takes longer than drawing them.
    """

    def __init__(self, axis: Axis) -> None:
        super().__init__()
        self._tick = axis.get_major_ticks(1)[0]
        low, high = sorted(axis.get_view_interval())
        places = axis.get_majorticklocs().tolist()
        labels = axis.get_major_formatter().format_ticks(places)
        self._places = [(x, label) for x, label in zip(places, labels, strict=True) if low <= x <= high]
        self._dpi = axis.axes.figure.dpi
        self._is_vertical = isinstance(axis, YAxis)
        self.set_zorder(axis.get_zorder())

    def draw(self, renderer: RendererBase) -> None:
        for place, label in self._places:
            self._tick.update_position(place)
            self._tick.label1.set_text(label)
            self._tick.draw(renderer)

    def reach(self) -> float:
        """Points from the axes' edge to the far end of ticks and labels."""
        if not self._places:
            return 0.0
        text, edge, side = self._tick.label1, self._tick.axes.bbox.min, 0 if self._is_vertical else 1
        if not text.get_visible():
            return float(self._tick.get_tick_padding())
        ends = []
        for place, label in self._places:
            self._tick.update_position(place)
            text.set_text(label)
            ends.append(text.get_window_extent().min[side])
        return float(72 * (edge[side] - min(ends)) / self._dpi)


def reach_on_the_left(axes: Axes) -> float:
    """Inches from the axes' left edge to the far end of its tick labels."""
    return MovedTick(axes.yaxis).reach() / 72


def draw_with_moved_ticks(figure: Figure) -> None:
    """Let a moved tick draw every axis of a finished figure: its limits and its size change no more."""
    axes_shown = [axes for axes in figure.axes if axes.get_visible() and axes.axison]
    moved = [(axes, axis, MovedTick(axis)) for axes in axes_shown for axis in (axes.xaxis, axes.yaxis)]
    for axes, axis, tick in moved:  # axes that share an axis share its locator, so that all ticks are found before
        axis.set_major_locator(NullLocator())
        axis.labelpad += tick.reach()  # else the axis's name is put where no labels are known of
        axes.add_artist(tick)
