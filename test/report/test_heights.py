"""The charts of heights: over time, and from the side of each radar."""

import numpy as np
import pytest
from records import SCANS, record_of

from phd_jdtc_ros.core.types import Attributes
from phd_jdtc_ros.report.page import charts, html
from phd_jdtc_ros.report.record import RadarSite


def in_space(record, unknown=False):
    """Return a record whose estimates have heights of 100 m times their numbers, or none."""

    def of(found):
        number = 1 + np.arange(len(found))
        height = np.stack([100.0 * number, np.zeros(len(found))], axis=1)
        found = found.changed(track_id=number)
        known = Attributes.unknown(len(found))
        return found.changed(
            attributes=known.changed(height=np.full_like(height, np.nan) if unknown else height)
        )

    changed = {name: tuple(map(of, getattr(record, name))) for name in ("filtered", "smoothed")}
    sites = (RadarSite("one", (0.0, 0.0), 10.0, (-0.05, 0.5)), RadarSite("two", (5e3, 0.0)))
    return type(record)(**{**vars_of(record), **changed, "radars": sites})


def vars_of(record):
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


def test_heights_are_those_of_each_track_over_time():
    record = in_space(record_of(2))
    tracks = charts.height_lines(record)
    assert {round(float(np.nanmean(path.height))) // 100 for path in tracks} == {
        int(number) for found in record.smoothed for number in found.track_id
    }
    figure = charts.heights_over_time(record, tracks).figure
    assert len(figure.data) == len(tracks)
    assert sum(trace.showlegend for trace in figure.data) == len({t.name for t in figure.data})
    assert max(map(len, (trace.x for trace in figure.data))) <= SCANS


def test_side_view_has_each_radar_with_a_height_and_the_edges_of_its_beam():
    record = in_space(record_of(2))
    chart = charts.heights_from_the_side(record, charts.height_lines(record))
    limits = [trace for trace in chart.figure.data if trace.name == "limit"]
    assert len(limits) == 2
    assert [trace.y[0] for trace in limits] == [10.0, 10.0]
    (down, up) = limits
    assert (down.y[1] - 10.0) / (1e3 * down.x[1]) == pytest.approx(np.tan(-0.05), rel=1e-2)
    assert (up.y[1] - 10.0) / (1e3 * up.x[1]) == pytest.approx(np.tan(0.5), rel=0.05)
    assert [note.text for note in chart.figure.layout.annotations] == ["<b>one</b>"]
    # The limit below the horizon leaves the axis.
    shown = [trace for trace in chart.figure.data if trace.name != "limit"]
    low, high = chart.figure.layout.yaxis.range
    assert low < 10.0 < max(max(trace.y) for trace in shown) < high
    assert low > min(10.0, *(min(trace.y) for trace in shown)) - 0.1 * (high - low) - 2.0


def test_page_has_charts_of_heights_where_these_are_known():
    known, unknown = in_space(record_of(2)), in_space(record_of(2), unknown=True)
    names = [chart.name for chart in html.charts_of(known, known.evaluate(1000.0, 2.0))]
    assert names[-2:] == ["heights", "sides"]
    names = [chart.name for chart in html.charts_of(unknown, unknown.evaluate(1000.0, 2.0))]
    assert not {"heights", "sides"} & {*names}
