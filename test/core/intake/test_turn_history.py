import numpy as np
import pytest
from antennas import TurningRadar

from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.intake.turn_history import TurnHistory
from phd_jdtc_ros.core.intake.turns import Turns

REPORTS = TurningRadar(sectors=8, plots=80).reports(8)


def fed(reports, rotation_s):
    """Return what has cut reports, and their pieces."""
    turns = Turns(rotation_s, reset_threshold_s=12.0)
    history = TurnHistory(turns)
    cut = [history.split(sent.stamp_ns, sent.detections, None) for sent in reports]
    return turns, history, cut


# Late are reports from before the turn is found, from just then, and from after it.
@pytest.mark.parametrize("late", [2, 10, 30])
@pytest.mark.parametrize("rotation_s", [0.0, 4.0])
def test_a_late_report_and_those_after_it_become_what_they_would_have_been(rotation_s, late):
    told, _, wanted = fed(REPORTS, rotation_s)
    turns, history, _ = fed([*REPORTS[:late], *REPORTS[late + 1 :]], rotation_s)
    sent = REPORTS[late]
    assert history.count_later(sent.stamp_ns) == len(REPORTS) - late - 1
    found = history.insert(sent.stamp_ns, sent.detections, None)
    expected = [piece for pieces in wanted[late:] for piece in pieces]
    assert [stamp_ns for stamp_ns, _ in found.slices] == [stamp_ns for stamp_ns, _ in expected]
    for (_, piece), (_, other) in zip(found.slices, expected, strict=True):
        assert piece.coverage == other.coverage
        np.testing.assert_array_equal(piece.measurement, other.measurement)
    assert (turns.period_s, turns.nominal_period_s) == (told.period_s, told.nominal_period_s)


def test_what_a_late_report_takes_the_place_of_is_named_by_its_first_stamps():
    _, history, cut = fed([*REPORTS[:30], *REPORTS[31:]], 4.0)
    found = history.insert(REPORTS[30].stamp_ns, REPORTS[30].detections, None)
    assert found.stamps_ns == [stamp_ns for pieces in cut[30:] for stamp_ns, _ in pieces]


def test_a_report_that_comes_once_more_or_before_all_has_no_place():
    _, history, _ = fed(REPORTS[1:], 4.0)
    assert history.count_later(REPORTS[5].stamp_ns) is Rejection.DUPLICATE
    assert history.count_later(REPORTS[0].stamp_ns) is Rejection.LATE
    history.forget_before(REPORTS[20].stamp_ns)
    assert history.count_later(REPORTS[20].stamp_ns - 1) is Rejection.LATE
    assert history.count_later(REPORTS[20].stamp_ns + 1) == len(REPORTS) - 21
