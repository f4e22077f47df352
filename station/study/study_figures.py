"""Charts of a study: forest plot of the volunteers, Bland–Altman plot of pairs."""

from __future__ import annotations

from station.charts.marks import Chart, Intervals, Mark, Panel, Points, Rule, Strip, chart, values
from station.study.study_document import AgreementEntry, QuantityEntry, StudyFigure
from station.study.units import SHOWN

ROW = 18.0
"""Height [px] of a volunteer in a forest plot."""
FRAME = 70.0
"""Height [px] of the axis and its name."""


def forest_chart(found: QuantityEntry, quantity: str) -> Chart:
    """Every volunteer with a 95 % interval; the mean as a line, the prediction interval as a strip."""
    scale, unit = SHOWN[quantity]
    names = tuple(mean.volunteer for mean in found.volunteers)
    places = values(range(len(names)))
    centres = values([scale * mean.value for mean in found.volunteers])
    ends = scale * values([mean.ci95 for mean in found.volunteers]).reshape(-1, 2)
    marks: list[Mark] = []
    if found.prediction:
        low, high = (scale * end for end in found.prediction.ci95)
        marks.append(Strip(low, high, "quiet", "95 % of new volunteers", is_upright=True))
    if found.mean:
        low, high = (scale * end for end in found.mean.ci95)
        marks.append(Strip(low, high, "c1", "mean, 95 %", is_upright=True))
        marks.append(Rule(scale * found.mean.value, "c1", is_upright=True))
    marks += [Intervals(places, ends[:, 0], ends[:, 1], "ink", is_upright=False), Points(centres, places, "ink")]
    height = FRAME + ROW * (len(names) + 1)
    limits = (-0.7, len(names) - 0.3)
    return chart(Panel(tuple(marks), f"{quantity} [{unit}]", y_names=names, y_limits=limits, height=height))


def agreement_chart(found: AgreementEntry, name: str, quantity: str) -> Chart:
    """Difference over mean of the pairs, bias, limits of agreement with their 95 % intervals."""
    scale, unit = SHOWN[quantity]
    marks: list[Mark] = [Rule(0.0, "quiet", dash="dotted")]
    for figure, label in ((found.lower_limit, "95 % limits of agreement"), (found.upper_limit, "")):
        marks += _limit(figure, scale, label)
    if found.bias.value is not None:
        marks.append(Rule(scale * found.bias.value, "c1", "bias"))
    marks.append(Points(scale * values(found.means), scale * values(found.differences), "ink"))
    return chart(Panel(tuple(marks), f"mean of both [{unit}]", f"difference [{unit}]", name))


def _limit(figure: StudyFigure, scale: float, label: str) -> list[Mark]:
    if figure.value is None or figure.ci95 is None:
        return []
    low, high = (scale * (end or 0.0) for end in figure.ci95)
    return [Strip(low, high, "c2"), Rule(scale * figure.value, "c2", label, "dashed")]
