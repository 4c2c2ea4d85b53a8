import numpy as np
import pytest
from records import SCANS, estimates_of, record_of, stamp_ns, truth_of

from msg_adapters.targets.markers import class_colour
from phd_jdtc_ros.core.types import Estimates
from phd_jdtc_ros.report.page import charts, html

TIMES = [6.0 * k for k in range(SCANS)]
NOTHING = tuple(estimates_of(k, 2, 0, 0) for k in range(SCANS))


def chart(draw, record):
    return draw(record, record.evaluate(1000.0, 2.0))


def lines(figure, name, row):
    axis = "x" if row == 1 else f"x{row}"
    return [t for t in figure.data if t.name == name and (t.xaxis or "x") == axis]


def line(figure, name, row):
    found = lines(figure, name, row)
    assert len(found) == 1
    return found[0]


def titles(figure):
    return [note.text for note in figure.layout.annotations]


@pytest.mark.parametrize("source", ["filtered", "smoothed"])
def test_ospa_has_the_scores_of_all_and_of_each_class(source):
    record = record_of(2)
    scores = record.evaluate(1000.0, 2.0).scores[source]
    figure = chart(charts.ospa, record).figure
    for row, key in enumerate(("all", "class_0", "class_1"), 1):
        drawn = line(figure, source, row)
        expected = [scores[stamp_ns(k)].values[key]["ospa"] for k in range(SCANS)]
        assert list(drawn.x) == TIMES
        np.testing.assert_allclose(drawn.y, expected, atol=0.01)


def test_charts_have_titles_of_means_and_class_colours():
    record = record_of(2, filtered=())
    mean = record.evaluate(1000.0, 2.0).summary()["smoothed"]["all"]["ospa"]
    shown = titles(chart(charts.ospa, record).figure)
    assert shown[0] == f"<b>all classes</b> \N{MIDDLE DOT} mean {mean:.0f} m smoothed"
    figure = chart(charts.ospa, record_of(3)).figure
    assert [line(figure, "smoothed", row).line.color for row in (2, 3, 4)] == [
        class_colour(k) for k in range(3)
    ]


def test_numbers_count_truth_and_estimates():
    record = record_of(2, truth=tuple(truth_of(k, 2 if k < 6 else 1) for k in range(SCANS)))
    figure = charts.numbers(record).figure
    assert list(line(figure, "truth", 1).y) == [2] * 6 + [1] * 6
    assert list(line(figure, "truth", 3).y) == [1] * 6 + [0] * 6
    assert list(line(figure, "filtered", 1).y) == [2, 1] * 6
    assert list(line(figure, "filtered", 2).y) == [1] * 12
    assert list(line(figure, "smoothed", 3).y) == [1] * 12
    drawn = charts.numbers(record_of(truth=()))
    assert {trace.name for trace in drawn.figure.data} == {"filtered", "smoothed"}
    assert "true number" not in drawn.caption


@pytest.mark.parametrize(
    ("highest", "step"), [(1, 1), (4, 1), (5, 2), (9, 5), (20, 5), (35, 10), (73, 20), (1500, 500)]
)
def test_numbers_have_round_ticks(highest, step):
    found = estimates_of(0, highest, 0)
    figure = charts.numbers(record_of(1, truth=(), filtered=(found,), smoothed=())).figure
    assert figure.layout.yaxis.dtick == step


def unsure(scan, first, track_id=(0, 0)):
    """Return the two estimates of a scan, the second of a class that is not the target's."""
    sure = estimates_of(scan, 2, 5)
    share = np.array([[first, 1.0 - first], [0.75, 0.25]])
    changed = {"class_probability": share, "class_id": np.array([0, 0])}
    return Estimates(**{**vars(sure), **changed, "track_id": np.array(track_id)})


def test_class_probabilities_follow_the_true_targets():
    record = record_of(2, smoothed=tuple(unsure(k, 0.5 + 0.04 * k) for k in range(SCANS)))
    figure = chart(charts.class_probabilities, record).figure
    first = line(figure, "smoothed, truly class 0", 1)
    assert list(first.x) == TIMES
    np.testing.assert_allclose(first.y, [0.5 + 0.04 * k for k in range(SCANS)])
    assert first.line.color == class_colour(0)
    # The other target is truly of class 1, whatever it was taken for.
    other = line(figure, "smoothed, truly class 1", 2)
    assert list(other.y) == [0.25] * SCANS
    assert other.line.color == class_colour(1)


def test_class_probabilities_separate_estimates_near_no_target():
    record = record_of(2, truth=tuple(truth_of(k, 1) for k in range(SCANS)))
    figure = chart(charts.class_probabilities, record).figure
    false = line(figure, "smoothed, near no target", 2)
    assert list(false.y) == [1.0] * SCANS
    assert false.mode == "markers"


def test_class_probabilities_are_shown_without_truth():
    figure = chart(charts.class_probabilities, record_of(2, truth=())).figure
    assert line(figure, "smoothed, class 1", 2).marker.color == class_colour(1)
    assert line(figure, "smoothed, class 1", 2).mode == "markers"
    record = record_of(2, truth=(), smoothed=tuple(unsure(k, 0.9, (7, 9)) for k in range(SCANS)))
    figure = chart(charts.class_probabilities, record).figure
    followed = lines(figure, "smoothed, class 0", 1)
    assert [trace.mode for trace in followed] == ["lines+markers"] * 2
    assert [list(trace.y) for trace in followed] == [[0.9] * SCANS, [0.75] * SCANS]


def test_filtered_class_probabilities_stand_behind_smoothed_ones_or_for_themselves():
    behind = chart(charts.class_probabilities, record_of(1)).figure
    alone = chart(charts.class_probabilities, record_of(1, smoothed=())).figure
    assert [trace.name for trace in behind.data] == ["filtered", "smoothed, truly class 0"]
    assert [trace.name for trace in alone.data] == ["filtered, truly class 0"]


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ({}, ["ospa", "numbers", "classes"]),
        ({"truth": ()}, ["numbers", "classes"]),
        ({"smoothed": ()}, ["ospa", "numbers", "classes"]),
        ({"filtered": (), "smoothed": ()}, ["numbers"]),
        ({"filtered": (), "smoothed": (), "truth": ()}, []),
        ({"plots": ()}, ["ospa", "numbers", "classes"]),
        ({"filtered": (), "smoothed": (), "truth": (), "plots": ()}, []),
        ({"filtered": NOTHING, "smoothed": NOTHING}, ["ospa", "numbers"]),
    ],
)
def test_of_record_draws_what_there_is(parts, expected):
    record = record_of(**parts)
    assert [c.name for c in html.charts_of(record, record.evaluate(1000.0, 2.0))] == expected


@pytest.mark.parametrize(
    ("parts", "notes"),
    [
        ({}, []),
        ({"truth": ()}, []),
        ({"smoothed": ()}, ["no smoothed estimates"]),
        ({"filtered": ()}, ["no filtered estimates"]),
        ({"filtered": (), "smoothed": ()}, ["no estimates in this bag"]),
        ({"plots": ()}, ["no detections"]),
        ({"truth": (truth_of(99, 2),)}, ["has the stamp of a true state"]),
    ],
)
def test_missing_lists_what_the_bag_lacks(parts, notes):
    record = record_of(**parts)
    found = html.notes_of(record, record.evaluate(1000.0, 2.0))
    assert len(found) == len(notes)
    for note, part in zip(found, notes, strict=True):
        assert part in note
