from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.schema import ConfigError, flatten
from phd_jdtc_ros.core.types import UNKNOWN
from phd_jdtc_ros.parameter_files import yaml_files
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.scenario import truth_after
from phd_jdtc_ros.simulation.simulate import simulate, simulate_with_sources
from phd_jdtc_ros.simulation.turning_antenna import simulate_reports

ROOT = Path(__file__).parents[2]
NAMES = ("code", "address", "height")


def terminal(given, seconds=61, names=NAMES):
    """Return a run of the terminal radar with transponders, and its configuration."""
    document = dict(yaml_files.load(ROOT / "config" / "scenarios" / "terminal_radar.yaml"))
    parameters = dict(flatten(document["parameters"]))
    if given is not None:
        document["transponders"] = given
        parameters |= {f"approach.fields.{name}": name for name in names}
    config = resolve(parameters)
    return scenario_file.resolve({**document, "scans": seconds}, config.model.radars), config


def plots(given, seed=1, names=NAMES):
    run, config = terminal(given, names=names)
    return run, simulate_reports(run, config.inputs, seed)


def test_plots_of_a_seed_are_the_same_without_transponders():
    _, plain = plots(None)
    _, answered = plots({}, names=("code", "address"))
    assert len(plain) == len(answered)
    for one, other in zip(plain, answered, strict=True):
        assert one.stamp_ns == other.stamp_ns
        np.testing.assert_array_equal(one.detections.measurement, other.detections.measurement)
        np.testing.assert_array_equal(one.detections.time_s, other.detections.time_s)
        assert one.detections.code is None
        assert other.detections.code is not None


def test_ranges_over_ground_use_the_heights_of_the_plots():
    replies = {"reply_probability": 0.5, "height_garbled": 0.1}
    run, over_ground = plots(replies, names=("code", "address"))
    _, reported = plots(replies)
    away = []
    for exact, report in zip(over_ground, reported, strict=True):
        rows = np.flatnonzero(report.source)
        source, time_s = report.source[rows], report.detections.time_s[rows]
        then = report.stamp_ns * 1e-9 - 1000.0 + time_s
        true = [run.heights(int(n), np.array([t]))[0, 0] for n, t in zip(source, then, strict=True)]
        said = report.detections.height[rows]
        distance = report.detections.measurement[rows, 0]
        wanted = exact.detections.measurement[rows, 0] ** 2 + np.square(true)
        wanted = np.sqrt(np.maximum(wanted - np.nan_to_num(said) ** 2, 0.0))
        np.testing.assert_allclose(distance, wanted, rtol=1e-9, atol=1e-3)
        away += [np.abs(distance - exact.detections.measurement[rows, 0])[np.isnan(said)].max()]
    assert max(away) > 100.0


def test_answers_are_those_of_the_targets_cards():
    run, reports = plots({"reply_probability": 0.9})
    replied = 0
    every = 0
    for report in reports:
        found = report.detections
        assert (found.code[report.source == 0] == UNKNOWN).all()
        for row in np.flatnonzero(report.source).tolist():
            content = run.replies_of[int(report.source[row])]
            every += 1
            if found.code[row] == UNKNOWN:
                assert found.address[row] == UNKNOWN
                assert np.isnan(found.height[row])
                continue
            replied += 1
            assert (found.code[row], found.address[row]) == (content.code, content.address)
            then = report.stamp_ns * 1e-9 - 1000.0 + found.time_s[row]
            assert found.height[row] == pytest.approx(
                content.height(np.array([then]))[0, 0], abs=15.3
            )
            flight_level = found.height[row] / 30.48
            assert flight_level == pytest.approx(np.round(flight_level), abs=1e-6)
    assert replied / every == pytest.approx(0.9, abs=0.03)


def test_truth_has_heights_that_change_at_its_climb_rates():
    run, _ = terminal({})
    first, later = truth_after(run, 30.0), truth_after(run, 30.01)
    rate = (later.height[:, 0] - first.height[:, 0]) / 0.01
    np.testing.assert_allclose(rate, first.height[:, 1], atol=1e-6)
    assert (first.height[:, 0] >= 0.0).all()
    slow = np.hypot(*first.velocity.T) < 12.0
    assert slow.any()
    assert not first.height[slow].any()


def test_shares_and_faults_of_the_document_are_named():
    run, _ = terminal({"share": 0.5, "shared_code_share": 0.3, "seed": 4})
    code = np.array([content.code for content in run.replies_of.values()])
    assert np.mean(code == UNKNOWN) == pytest.approx(0.5, abs=0.15)
    assert np.mean(code[code != UNKNOWN] == 0o7000) == pytest.approx(0.3, abs=0.2)
    with pytest.raises(ConfigError) as refused:
        terminal({"share": 1.5, "code": 3})
    assert "transponders.share" in str(refused.value)
    assert "transponders.code: unknown key" in str(refused.value)


def test_garbled_answers_and_addresses_are_as_frequent_as_asked_for():
    run, reports = plots({"code_garbled": 0.2, "reply_probability": 1.0})
    wrong = [
        report.detections.code[row] != run.replies_of[int(report.source[row])].code
        for report in reports
        for row in np.flatnonzero(report.source).tolist()
    ]
    assert np.mean(wrong) == pytest.approx(0.2, abs=0.05)
    source, code, address, height = answers_of({})
    _, same_code, garbled, same_height = answers_of({"address_garbled": 0.1})
    np.testing.assert_array_equal(code, same_code)
    np.testing.assert_array_equal(height, same_height)
    answered = address != UNKNOWN
    np.testing.assert_array_equal(answered, garbled != UNKNOWN)
    assert np.mean(garbled[answered] != address[answered]) == pytest.approx(0.1, abs=0.03)
    assert (source[answered] > 0).all()


def test_radars_that_do_not_turn_see_answers_too():
    run, _ = terminal({"reply_probability": 1.0}, 3)
    still = replace(run, radars=tuple(replace(radar, rotation_s=0.0) for radar in run.radars))
    for _, scan, (source,) in simulate_with_sources(still, 2):
        found = scan.detections[0]
        expected = [still.replies_of[n].code if n else UNKNOWN for n in source.tolist()]
        assert found.code.tolist() == expected
    plain = simulate(replace(still, transponders=None), 2)
    for (_, scan), (_, other) in zip(simulate(still, 2), plain, strict=True):
        one, two = scan.detections[0], other.detections[0]
        np.testing.assert_array_equal(one.measurement, two.measurement)


def answers_of(given):
    _, reports = plots(given)
    source = np.concatenate([report.source for report in reports])
    columns = (
        np.concatenate([getattr(report.detections, name) for report in reports]) for name in NAMES
    )
    return source, *columns


def test_targets_without_mode_s_answer_with_codes_only():
    source, code, address, _ = answers_of({"mode_s_share": 0.6, "reply_probability": 1.0})
    numbers = np.unique(source[source > 0])
    known = [n for n in numbers if (address[source == n] != UNKNOWN).all()]
    unknown = [n for n in numbers if (address[source == n] == UNKNOWN).all()]
    assert len(known) + len(unknown) == len(numbers)
    assert len(known) / len(numbers) == pytest.approx(0.6, abs=0.15)
    assert (code[source > 0] != UNKNOWN).all()


def test_aircraft_take_off_from_the_ground_and_land_on_it():
    document = dict(yaml_files.load(ROOT / "config" / "scenarios" / "terminal_radar.yaml"))
    document |= {"scans": 3601, "transponders": {}}
    config = resolve(dict(flatten(document["parameters"])))
    run = scenario_file.resolve(document, config.model.radars)
    began = landed = 0
    for number, flight in enumerate(run.flights, start=1):
        first, last = run.heights(number, np.array([flight.start_s, flight.end_s]))[:, 0]
        if 40.0 < np.hypot(*flight.velocity) < 85.0:
            began += 1
            assert first == 0.0
        elif 40.0 < np.hypot(*flight.end_velocity) < 85.0:
            landed += 1
            assert last == pytest.approx(0.0, abs=1e-6)
    assert began > 3
    assert landed > 3
