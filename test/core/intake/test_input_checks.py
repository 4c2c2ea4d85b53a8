from collections import Counter

import numpy as np
import pytest
from antennas import TurningRadar
from reference import resolve

from phd_jdtc_ros.core.engine import Step
from phd_jdtc_ros.core.intake.input_checks import (
    FIELD_DETECTIONS,
    FIELD_REPORTS,
    PATIENCE,
    SECTOR_REPORTS,
    PositionReportCheck,
    RadarReportCheck,
    ResultCheck,
)
from phd_jdtc_ros.core.types import Detections, Scan

S = 1_000_000_000
LIDAR = {"sensors": ["lidar"], "lidar.kind": "position"}


def at(azimuth):
    azimuth = np.asarray(azimuth, dtype=float)
    return Detections(np.stack([np.full(len(azimuth), 1000.0), azimuth], axis=1), None)


def noticed(check, reports):
    return Counter(finding for report in reports for finding in check.add(report))


def uniform(count, size, low=-np.pi, high=np.pi):
    rng = np.random.default_rng(2)
    return [at(rng.uniform(low, high, size)) for _ in range(count)]


def check_of(**changes):
    return resolve({f"radar_1.{name}": value for name, value in changes.items()}).report_checks()[0]


@pytest.mark.parametrize("sectors", [4, 16])
def test_sectors_that_are_not_configured_are_noticed(sectors):
    radar = TurningRadar(sectors=sectors, plots=40 * sectors)
    reports = [sent.detections for sent in radar.reports(2 * SECTOR_REPORTS // sectors + 1)]
    assert noticed(check_of(), reports)["sectors_not_configured"] > 0
    configured = check_of(rotation_s=4.0, sectors=sectors)
    assert not noticed(configured, reports)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 20])
def test_clutter_all_around_is_not_taken_for_sectors(size):
    assert not noticed(check_of(), uniform(500, size))


def of_targets(times, seed, copied=0.0, velocity=0.0, false=0):
    """Return reports of three targets with 5 m of noise; those at odd places may be copies."""
    rng, reports = np.random.default_rng(seed), []
    for number, time in enumerate(times):
        if copied and number % 2:
            again = reports[-1].measurement
            noise = rng.normal(0.0, [copied, 1e-3 * copied], again.shape)
            reports.append(Detections(again + noise, None))
            continue
        place = np.array([[900.0, 0.1], [2e3, 1.0], [3e3, -2.0]])
        place[:, 0] += velocity * time
        place += rng.normal(0.0, [5.0, 5e-3], (3, 2))
        clutter = rng.uniform([0.0, -3.0], [5e3, 3.0], (rng.poisson(false), 2))
        reports.append(Detections(np.concatenate([place, clutter]), None))
    return reports


@pytest.mark.parametrize("false", [0, 4])
@pytest.mark.parametrize("apart_s", [0.05, 0.5])
def test_reports_that_nearly_repeat_the_one_before_are_noticed(false, apart_s):
    times = [second + half for second in range(60) for half in (0.0, apart_s)]
    found = noticed(check_of(), of_targets(times, 1, 0.02, 10.0, false))
    assert found.keys() == {"reports_nearly_repeated"}
    assert found["reports_nearly_repeated"] > 40


@pytest.mark.parametrize("velocity", [0.0, 10.0, 40.0])
def test_looks_in_quick_succession_at_near_targets_are_no_copies(velocity):
    times = [second + half for second in range(60) for half in (0.0, 0.05)]
    assert not noticed(check_of(), of_targets(times, 2, 0.0, velocity, 0))
    assert not noticed(check_of(), of_targets(range(100), 3, 0.0, velocity, 3))


@pytest.mark.parametrize("seed", range(40))
def test_misses_and_rare_false_detections_make_no_copies(seed):
    rng, reports = np.random.default_rng(seed), []
    for time in np.arange(0.0, 10.0, 0.1):
        place = np.array([[900.0 + 12.0 * time, 0.1], [2e3 - 9.0 * time, 1.0]])
        place += rng.normal(0.0, [0.2, 1e-4], (2, 2))
        false = rng.uniform([0.0, -3.0], [5e3, 3.0], (rng.poisson(0.3), 2))
        seen = place[rng.random(2) < 0.9]
        reports.append(Detections(np.concatenate([seen, false]), None))
    assert not noticed(check_of(), reports)


def test_a_report_that_repeats_the_one_before_is_noticed():
    reports = uniform(20, 5)
    twice = [report for each in reports for report in (each, at(each.measurement[:, 1]))]
    assert not noticed(check_of(), reports)
    assert noticed(check_of(), twice) == {"reports_repeated": 20}
    # Where one report is a copy, so is each one of fewer detections.
    smaller = [report.take(np.arange(2)) for report in twice[2:]]
    assert noticed(check_of(), twice[:2] + smaller) == {"reports_repeated": 20}
    # Coarse measurements of targets at rest differ in their amplitudes.
    louder = [report.changed(amplitude=np.arange(5.0) + n) for n, report in enumerate(twice)]
    assert not noticed(check_of(), louder)
    # Few coarse detections of targets at rest repeat by themselves.
    assert not noticed(check_of(), [at([0.1, 0.2, 0.3, 0.4])] * 20)


def test_the_field_of_view_is_checked_once_by_many_directions():
    assert not noticed(RadarReportCheck(reports_sectors=False), uniform(100, 20, 0.0, 1.0))
    reports = uniform(FIELD_DETECTIONS - 1, 1, -1.0, 1.0)
    assert not noticed(check_of(), reports)
    few = FIELD_REPORTS - 1
    check, reports = check_of(), uniform(3 * FIELD_REPORTS, 10, -1.0, 1.0)
    assert not noticed(check, reports[:few])
    assert noticed(check, reports[few:]) == {"fov_not_configured": 1}
    assert not noticed(check_of(fov_deg=[-60.0, 60.0]), reports)
    assert not noticed(check_of(rotation_s=4.0), reports)


FAR = {"rotation_s": 4.0, "max_range": 110e3, "clutter_max_range": 110e3}


def test_slant_ranges_without_a_height_are_noticed_once_where_targets_fly_high():
    check = check_of(**FAR)
    assert not noticed(check, [at([])])
    assert noticed(check, uniform(30, 10)) == {"slant_ranges": 1}


@pytest.mark.parametrize(
    "changes",
    [
        {"fields.height": "height"},
        {"fields.elevation": "elevation"},
        {"message": "radar_scan"},
        {"max_range": 30e3, "clutter_max_range": 30e3},
        {"rotation_s": 2.0},
    ],
)
def test_slant_ranges_are_no_matter_where_the_height_is_known_or_small(changes):
    assert not noticed(check_of(**{**FAR, **changes}), uniform(30, 10))


def test_azimuths_in_radians_that_are_read_as_degrees_are_noticed_once():
    reports = uniform(40, 20, 0.0, np.radians(2.0 * np.pi))
    turning = {"rotation_s": 4.0, "units.azimuth": "deg"}
    for convention in ("enu_ccw", "compass_cw"):
        check = check_of(**turning, **{"units.azimuth_convention": convention})
        assert noticed(check, reports) == {"azimuths_in_radians": 1}
    assert not noticed(check_of(**turning | {"units.azimuth": "rad"}), reports)
    assert not noticed(check_of(**turning, fov_deg=[-3.0, 3.5]), reports)
    assert not noticed(check_of(**turning), uniform(40, 20, 0.0, 0.2))
    assert not noticed(check_of(**turning), uniform(40, 20, 0.0, 0.03))


def test_azimuths_in_turns_are_noticed_where_they_fill_their_first_unit():
    for unit, size in (("rad", 1.0), ("deg", np.radians(1.0))):
        reports = uniform(40, 20, 0.0, size)
        assert noticed(check_of(**{"units.azimuth": unit}, rotation_s=4.0), reports) == {
            "azimuths_in_turns": 1
        }
        compass = {
            "units.azimuth": unit,
            "rotation_s": 4.0,
            "units.azimuth_convention": "compass_cw",
        }
        from_north = uniform(40, 20, 0.5 * np.pi - size, 0.5 * np.pi)
        assert noticed(check_of(**compass), from_north) == {"azimuths_in_turns": 1}
        for low, high in ((-0.5, 0.5), (0.1, 1.0), (0.0, 0.9), (0.0, 1.1)):
            part = uniform(40, 20, low * size, high * size)
            assert not noticed(check_of(**{"units.azimuth": unit}, rotation_s=4.0), part)


def test_ranges_in_kilometres_are_noticed_once_where_the_radar_sees_far():
    reports = uniform(40, 20)
    assert noticed(check_of(max_range=1e6, clutter_max_range=1e6), reports) == {"ranges_near": 1}
    few = reports[:9]
    assert not noticed(check_of(max_range=1e6, clutter_max_range=1e6), few)
    assert not noticed(check_of(), reports)


def step(targets, due=True):
    """Return a step with so many targets in the estimates that are due."""
    return Step(((None,) * targets,) if due else (), (), np.zeros(2), {})


def scans(count, size, interval_s=4.0, first=0):
    return [Scan(round((first + k) * interval_s * S), (at(np.zeros(size)),)) for k in range(count)]


def test_targets_are_overdue_after_scans_with_detections_alone():
    check = ResultCheck(4.0)
    overdue = [check.note_step(scan, step(0)) for scan in scans(2 * PATIENCE, 5)]
    assert np.flatnonzero(overdue).tolist() == [PATIENCE - 1, 2 * (PATIENCE - 1)]
    assert check.scans == 2 * PATIENCE
    check = ResultCheck(4.0)
    assert not any(check.note_step(scan, step(0)) for scan in scans(3 * PATIENCE, 0))
    overdue = [
        check.note_step(scan, step(k == PATIENCE - 1)) for k, scan in enumerate(scans(50, 5))
    ]
    assert not any(overdue[:PATIENCE])
    assert check.scans == 50 - PATIENCE
    check = ResultCheck(4.0)
    overdue = [check.note_step(scan, step(0)) for scan in scans(PATIENCE * 16, 5, 0.25)]
    assert sum(overdue) == 1
    check = ResultCheck(4.0)
    assert not any(check.note_step(scan, step(0, due=False)) for scan in scans(3 * PATIENCE, 5))


def places(*rows):
    return Detections(np.array(rows, dtype=float), None)


def test_copies_of_positions_are_noticed_but_not_rounded_ones_of_targets_at_rest():
    rng = np.random.default_rng(4)
    drawn = [places(*rng.uniform(-50.0, 50.0, (6, 2))) for _ in range(3)]
    twice = [each for each in drawn for _ in range(2)]
    assert noticed(PositionReportCheck(), twice) == {"reports_repeated": 3}
    # Vehicles that stand, in whole metres.
    standing = [places(*np.rint(drawn[0].measurement))] * 5
    assert not noticed(PositionReportCheck(), standing)


@pytest.mark.parametrize("unknown", [-999.0, 0.0])
def test_number_that_stands_for_an_unknown_place_is_noticed(unknown):
    rng = np.random.default_rng(5)
    drawn = [rng.uniform(-50.0, 50.0, (6, 2)) for _ in range(4)]
    filled = [places(*each, (unknown, unknown)) for each in drawn]
    assert noticed(PositionReportCheck(), filled) == {"positions_constant": 3}
    # A vehicle that stands, and one that moves along the line on which x = y.
    crossing = [places(*each, (7.0, 8.0), (k, k)) for k, each in enumerate(drawn)]
    assert not noticed(PositionReportCheck(), crossing)


@pytest.mark.parametrize("marked", [(-999.0, -999.0), (0.0, 0.0), (9999.0, -9999.0)])
@pytest.mark.parametrize("every", [1, 3])
def test_a_repeated_number_for_unknown_places_is_no_detection(marked, every):
    rng, check = np.random.default_rng(5), PositionReportCheck()
    for k in range(12):
        others = rng.uniform(-50.0, 50.0, (1 + k % 4, 2))
        filled = places(*others, *([marked] if k % every == 0 else []))
        check.add(filled)
        # Five others have to show first that nothing else repeats.
        assert len(check.used(filled)) == (len(filled) if k < 2 else len(others))


def test_a_target_at_rest_without_noise_stays_a_detection():
    check = PositionReportCheck()
    for _ in range(12):
        alone = places((0.0, 0.0))
        check.add(alone)
        assert len(check.used(alone)) == 1


def test_rounded_places_of_targets_at_rest_stay_detections():
    rng, check = np.random.default_rng(5), PositionReportCheck()
    for _ in range(6):
        standing = places((2.0, 2.0), (7.0, -3.0), *rng.uniform(-50.0, 50.0, (2, 2)))
        check.add(standing)
        assert len(check.used(standing)) == 4


def test_targets_at_rest_show_that_other_positions_are_rounded_too():
    # Degrees that were rounded, and then converted: no step of metres, but the same again.
    rng = np.random.default_rng(6)
    rest = rng.uniform(-50.0, 50.0, (6, 2))
    check = PositionReportCheck()
    passing = [places(*rest, 50.0 * rng.random(2)) for _ in range(3)]
    assert not noticed(check, [*passing, places(*rest), places(*rest)])


def test_positions_have_no_azimuths():
    # All in one direction, from x and y whose second column is no angle.
    rng = np.random.default_rng(8)
    found = [places(*rng.uniform(0.0, 0.3, (5, 2))) for _ in range(120)]
    assert not noticed(resolve(LIDAR).report_checks()[0], found)
    assert noticed(check_of(), [at(each.measurement[:, 1]) for each in found])
