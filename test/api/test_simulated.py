"""Scenarios as tables."""

import numpy as np
import pytest

from msg_adapters.incoming.readers import reader_of
from phd_jdtc_ros import simulate
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.parameter_files import from_arguments, tracker_params


def recorded(bag):
    """Return the stamps and clouds of a bag's radars as a table of ranges and azimuths."""
    config = tracker_params.config(from_arguments.load(bag / "parameters.yaml"))
    radars = {radar.topic: radar for radar in config.inputs}
    rows = []
    for entry in BagReader(bag).messages(list(radars)):
        radar = radars[entry.topic]
        found = reader_of(radar).from_cdr(entry.data, radar).detections
        rows += [(entry.stamp_ns / 1e9, radar.name, *row) for row in found.measurement.tolist()]
    return rows


def test_simulate_gives_what_the_shipped_bag_has(request):
    found = simulate("one_radar", seed=0).detections
    expected = recorded(request.config.rootpath / "bags" / "one_radar")

    assert len(found) == len(expected)
    assert found["time"].tolist() == [row[0] for row in expected]
    assert found["radar"].tolist() == [row[1] for row in expected]
    measured = np.stack([found["range"], found["azimuth"]], axis=1)
    np.testing.assert_allclose(measured, [row[2:] for row in expected], rtol=2e-7)


def test_simulate_without_a_scenario_is_the_reference_scenario():
    run = simulate(seed=3)

    assert np.unique(run.detections["radar"]).tolist() == ["radar_1", "radar_2"]
    assert np.unique(run.truth["label"]).tolist() == [1, 2, 3, 4]
    assert len(np.unique(run.truth["time"])) == 80


def test_simulate_takes_a_document():
    target = {
        "class_id": 0,
        "snr_db": 30.0,
        "position": [-2000.0, 500.0],
        "velocity": [20.0, 0.0],
        "first_scan": 0,
        "last_scan": 9,
    }

    run = simulate({"scans": 10, "targets": [target]}, seed=3)

    assert run.truth["x"].tolist() == [-2000.0 + 120.0 * scan for scan in range(10)]


def test_simulate_gives_a_scan_without_detections_a_row():
    run = simulate(
        {
            "scans": 5,
            "targets": [],
            "parameters": {"sensors": ["only"], "only": {"clutter_rate": 0.0}},
        },
        seed=3,
    )

    assert run.detections["time"].tolist() == [1000.0 + 6.0 * scan for scan in range(5)]
    assert np.isnan(run.detections["range"]).all()


def test_simulate_gives_plots_of_turning_antennas_their_own_times():
    run = simulate("terminal_radar", seed=1)

    assert run.parameters["approach.fields.time"] == "time"
    assert len(np.unique(run.detections["time"])) > 0.99 * len(run.detections)


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        ("coastal_ship", "platform: given, must be absent"),
        ("no_such", "scenario: 'no_such' given, must be .* one of approach_hour, automotive, "),
        ("no_such.yaml", "no_such.yaml: cannot be read"),
        ({"scans": -1}, "scans: -1"),
    ],
)
def test_simulate_reports_what_does_not_fit(scenario, said):
    with pytest.raises(ConfigError, match=said):
        simulate(scenario, seed=0)


@pytest.mark.parametrize("seed", [-1, "x", 1.5])
def test_simulate_names_a_seed_that_is_none(seed):
    with pytest.raises(ConfigError, match=r"seed: .* given, must be a whole number from 0 on"):
        simulate("one_radar", seed=seed)
