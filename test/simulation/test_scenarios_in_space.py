"""The shipped scenarios of aircraft in space: their heights come out, of one radar or of two."""

from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros import Tracker, evaluate
from phd_jdtc_ros import simulate as simulate_tables
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.parameter_files import yaml_files
from phd_jdtc_ros.parameter_files.from_arguments import scenario_parameters
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.simulate import simulate

SCENARIOS = Path(__file__).parents[2] / "config" / "scenarios"


@pytest.mark.parametrize(("name", "in_height"), [("air_3d", 250.0), ("two_slant", 250.0)])
def test_aircraft_are_tracked_with_their_heights(name, in_height):
    document = yaml_files.load(SCENARIOS / f"{name}.yaml")
    config = resolve(scenario_parameters(document))
    scenario, engine = scenario_file.resolve(document, config.model.radars), new_engine(config)
    missed, errors = 0, []
    run = simulate(scenario, 5)[:25]
    for index, (truth, scan) in enumerate(run):
        found = engine.step(scan).filtered[0]
        if index < 15:
            continue
        apart = np.hypot(*(found.position[:, None] - truth.position).T)
        near = apart.argmin(axis=1)
        here = apart[np.arange(len(truth.state)), near] < 1500.0
        missed += np.count_nonzero(~here)
        errors += list(found.attributes.height[near[here], 0] - truth.height[here, 0])
    total = sum(len(truth.state) for truth, _ in run[15:])
    assert missed < 0.02 * total
    known = np.array(errors)[np.isfinite(errors)]
    assert len(known) > 0.9 * total
    assert np.median(np.abs(known)) < in_height


@pytest.mark.filterwarnings("ignore:.*clouds are missing by the stamps")
def test_a_radar_that_turns_tracks_aircraft_with_their_heights_sector_by_sector():
    run = simulate_tables(SCENARIOS / "turning_3d.yaml", seed=6)
    # Each sector with detections has a time of its own.
    assert len(np.unique(run.detections["time"])) > 500
    for tracks, height_rms in zip(
        Tracker(run.parameters).track(run.detections), (130.0, 80.0), strict=True
    ):
        later = tracks[tracks["time"] > 1040.0]
        times = np.unique(later["time"])
        scores = evaluate(run.truth, later, cutoff=1000.0, times=times)
        assert scores["missed"] < 0.05 * 8
        assert scores["false"] < 0.3
        assert scores["identity_switches"] == 0
        assert scores["height_rms"] < height_rms
