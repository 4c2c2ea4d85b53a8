"""What the sensors of a scan could show of a target: the share that they see, and its spread."""

from dataclasses import replace

import numpy as np
import pytest
from track_inputs import MODEL, SHARP, beyond, estimates_of, missed_by, scan_of, spread_by, views_of

from phd_jdtc_ros.core.tracks.coverage import missed_and_spread
from phd_jdtc_ros.core.types import Coverage, Detections, Pose, Scan

# Probability that both radars miss a target of the second class.
MISSED = missed_by(scan_of(0))


def test_coverage_is_that_of_the_whole_density():
    missed, spread = spread_by(SHARP)
    assert missed == pytest.approx(MISSED, rel=1e-6)
    # The spread is in standard deviations of the noise, and by area.
    for factor in (4.0, 9.0):
        assert spread_by(factor * SHARP)[1] == pytest.approx(np.sqrt(factor) * spread, rel=1e-3)
    # Of a density within the range of the radars, and of one beyond it, a part is outside.
    wide = np.diag([1e8, 1.0, 1e8, 1.0, 1e-6])
    assert spread_by(SHARP, beyond(MODEL, 1e4))[0] == pytest.approx(missed)
    assert 2.0 * missed < spread_by(wide, beyond(MODEL, 1e4))[0] < 0.5
    assert spread_by(wide, beyond(MODEL, 3e3))[0] == 1.0


def test_missed_counts_radars_that_reported_where_they_were():
    one = missed_by(replace_report(1, None))
    assert one == pytest.approx(np.sqrt(MISSED))
    behind = Detections(np.zeros((0, 2)), None, coverage=Coverage(0.5 * np.pi, np.pi))
    assert missed_by(replace_report(1, behind)) == one
    far = Pose((5e3 + 2.0 * MODEL.radars[1].max_range, 0.0), 0.0)
    away = Detections(np.zeros((0, 2)), None, pose=far)
    assert missed_by(replace_report(1, away)) == one
    near = replace(away, pose=Pose((5e3, 100.0), 0.0))
    assert missed_by(replace_report(1, near)) < one


def test_a_precise_sensor_that_sees_another_place_makes_no_track_wide():
    coarse, other = MODEL.radars
    near = replace(other.visibility, max_range=100.0)
    precise = replace(other, range_std=0.01 * other.range_std, visibility=near)
    model = replace(MODEL, radars=(coarse, precise))
    found = estimates_of(0, {1: 1.0}).changed(covariance=np.array([SHARP]))
    _, resolved = missed_and_spread(found, scan_of(0), MODEL, views_of(MODEL))
    alone = replace_report(0, None)
    missed, spread = missed_and_spread(found, alone, model, views_of(model))
    assert missed == 1.0
    assert spread == pytest.approx(resolved, rel=0.5)


def replace_report(index, report):
    scan = scan_of(0)
    reports = list(scan.detections)
    reports[index] = report
    return Scan(0, tuple(reports))
