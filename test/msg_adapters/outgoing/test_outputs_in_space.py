"""Every output of a tracker in space: all encoders take its scans, steps and estimates."""

from pathlib import Path

import numpy as np
import pytest

from msg_adapters.outgoing import outputs
from msg_adapters.targets.tracks import Trails
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core.types import FILTERED, SMOOTHED, Pose
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.parameter_files import yaml_files
from phd_jdtc_ros.parameter_files.from_arguments import scenario_parameters
from phd_jdtc_ros.simulation import scenario_file
from phd_jdtc_ros.simulation.simulate import simulate

SCENARIO = Path(__file__).parents[3] / "config" / "scenarios" / "drones.yaml"
SCANS = 14


@pytest.fixture(scope="module")
def tracked():
    """Return the view of a tracker of drones, its last scan and step, and its estimates."""
    document = yaml_files.load(SCENARIO)
    config = resolve(scenario_parameters(document))
    scenario = scenario_file.resolve(document, config.model.radars)
    engine, scans = new_engine(config), [scan for _, scan in simulate(scenario, 1)[:SCANS]]
    steps = [engine.step(scan) for scan in scans]
    view = outputs.View(
        frame="map",
        class_names=("drone", "bird"),
        radars=config.model.radars,
        plane=SystemPlane([52.0, 4.0, 10.0]),
        trails=Trails(10),
        own_pose=lambda _: Pose((0.0, 0.0), 0.0),
    )
    result = outputs.StepResult(scans[-1].stamp_ns, steps[-1], 1.0, engine)
    given = {
        outputs.SCAN: scans[-1],
        outputs.STEP: result,
        FILTERED: steps[-1].filtered[-1],
        SMOOTHED: steps[-1].smoothed[-1],
    }
    return view, given


def test_every_topic_has_messages(tracked):
    view, given = tracked
    rows = [row for row in outputs.table(2, "gaussian") if row.needs(view) and row.when in given]
    assert len(rows) > 15
    for row in rows:
        try:
            messages = list(row.encode(given[row.when], view))
        except ImportError:  # Messages that an installation may lack
            continue
        assert messages, row.topic


def test_every_stream_has_messages(tracked):
    view, given = tracked
    found = given[FILTERED]
    assert len(found) > 3
    for row in outputs.STREAMS:
        assert row.encode(found, view, view.own_pose(found.stamp_ns)), row.switch


def test_detections_are_at_their_heights(tracked):
    view, given = tracked
    (topic,) = [row for row in outputs.table(2) if row.switch == "detections"]
    (data,) = topic.encode(given[outputs.SCAN], view)
    (found,) = given[outputs.SCAN].detections
    rows = np.frombuffer(data[-(20 * len(found) + 1) : -1], dtype="<f4").reshape(-1, 5)
    distance, azimuth, elevation = found.measurement.T
    (radar,) = view.radars
    np.testing.assert_allclose(rows[:, 2], radar.height + distance * np.sin(elevation), rtol=1e-4)
    level = distance * np.cos(elevation)
    np.testing.assert_allclose(rows[:, 0], level * np.cos(azimuth), rtol=1e-4, atol=0.1)
