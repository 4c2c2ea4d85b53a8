"""Tests of the limits and false plots of recorded radars: gaps, cones, horizons, mirrors."""

import numpy as np
import pytest
from scenario_blocks import exact

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.core.types import UNKNOWN
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.looks import TurningRadar
from phd_jdtc_ros.simulation.turning_antenna import plots_with_replies

PARAMETERS = {
    **exact("hill", 300e3, geodetic=[50.0, 8.5, 130.0], rotation_s=4.0),
    "world_origin": [50.0, 8.5, 100.0],
    "hill.fields.height": "height",
    "hill.fields.amplitude": "",
    "classes": ["aircraft"],
    "births": [],
}
MIRROR = {"position": [3000.0, 4000.0], "probability": 1.0}
# Height of the target above the antenna, metres.
ABOVE = 100.0 + 5000.0 - 130.0
# The flight leads from the south over the radar to the north, at 5 km.
OVERHEAD = {
    "class_id": 0,
    "position": [10.0, -60e3],
    "velocity": [0.0, 200.0],
    "height": 5000.0,
    "legs": [{"duration_s": 600.0}],
}


def plots(**document):
    given = {"scans": 601, "interval_s": 1.0, "targets": [OVERHEAD], "transponders": {}, **document}
    config = resolve(PARAMETERS, SystemPlane)
    run = scenario_file.resolve(given, config.model.radars)
    radar = TurningRadar(run, 0, config.inputs[0])
    found, answers = plots_with_replies(radar, 1)
    return run, radar.times_at(found.turns), found, answers


def test_target_in_a_gap_has_no_plots():
    run, time_s, _, _ = plots(gaps={"count": 1, "shortest_s": 60.0, "longest_s": 61.0, "seed": 2})
    (gap,) = run.gaps
    assert not ((time_s >= gap.start_s) & (time_s < gap.end_s)).any()
    missing = np.flatnonzero(np.diff(time_s) > 8.0)
    assert len(missing) == 1
    assert time_s[missing[0]] == pytest.approx(gap.start_s, abs=4.01)


def test_target_is_not_seen_above_and_below_the_beam():
    _, _, everything, _ = plots()
    _, _, found, _ = plots(antennas={"hill": {"lowest_deg": 6.0, "highest_deg": 45.0}})
    assert 0 < len(found.turns) < len(everything.turns)
    sine = ABOVE / found.measurement[:, 0]
    # The earth's curvature is 0.1 degrees at these ranges.
    assert 5.8 < np.degrees(np.arcsin(sine)).min() < 6.5
    assert 40.0 < np.degrees(np.arcsin(sine)).max() < 45.1


def test_mirrored_answer_is_seen_at_the_mirror_farther_by_the_detour():
    mirror = {**MIRROR, "start_deg": 170.0, "width_deg": 20.0}
    run, time_s, found, answers = plots(mirrors=[mirror], transponders={"reply_probability": 1.0})
    false = found.source == 0
    # While it is in the south, once a turn.
    assert np.count_nonzero(false) == pytest.approx(75, abs=2)
    assert (found.replying == 1).all()
    assert (answers.address[false] == run.replies_of[1].address).all()
    assert (answers.code[false] == run.replies_of[1].code).all()
    np.testing.assert_allclose(found.measurement[false, 1], np.arctan2(4.0, 3.0), atol=1e-4)
    y = -60e3 + 200.0 * time_s[false]
    path = 5000.0 + np.hypot(y - 4000.0, 10.0 - 3000.0)
    slant = found.measurement[false, 0] - (path - np.hypot(10.0, y))
    np.testing.assert_allclose(slant, np.sqrt(y**2 + ABOVE**2), rtol=2e-3)


def test_mirror_reflects_no_target_in_other_directions_or_without_a_transponder():
    mirror = {**MIRROR, "start_deg": 45.0, "width_deg": 90.0}
    assert (plots(mirrors=[mirror])[2].source == 1).all()
    everywhere = {**mirror, "width_deg": 360.0}
    assert (plots(mirrors=[everywhere])[2].source == 0).any()
    _, _, found, answers = plots(mirrors=[everywhere], transponders={"share": 0.0})
    assert (found.source == 1).all()
    assert (answers.address == UNKNOWN).all()


def test_plots_before_scan_0_are_left_out():
    config = resolve({**PARAMETERS, "hill.clutter_rate": 50.0}, SystemPlane)
    antennas = {"hill": {"bearing_deg": 200.0}}
    given = {"scans": 61, "interval_s": 1.0, "antennas": antennas}
    run = scenario_file.resolve(given, config.model.radars)
    radar = TurningRadar(run, 0, config.inputs[0])
    found, answers = plots_with_replies(radar, 1)
    assert len(found.turns) == len(answers) > 500
    assert radar.times_at(found.turns).min() >= 0.0
