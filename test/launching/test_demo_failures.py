"""What the demo's launch file does about a node that cannot start, and about no truth."""

from itertools import islice
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory
from bag_content import write

from msg_adapters.encoding import names
from phd_jdtc_ros.bags.reader import BagReader

launch = pytest.importorskip("launch", reason="launch is not installed")
actions = pytest.importorskip("launch.actions", reason="launch is not installed")
sources = pytest.importorskip("launch.launch_description_sources")
handlers = pytest.importorskip("launch.event_handlers")
pytest.importorskip("launch_ros", reason="launch_ros is not installed")

try:
    SHARE = Path(get_package_share_directory("phd_jdtc_ros"))
except LookupError:
    pytest.skip("the package is not built with colcon", allow_module_level=True)

pytestmark = pytest.mark.live

# Only the node looks at it, so that the launch file has no objection.
BAD = """
/**/tracker:
  ros__parameters:
    max_wait_s: -1.0
"""


def ended(arguments, monkeypatch, status=0):
    """Run the demo, which ends with `status`; return that of each process by its name."""
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        # The variables that launch sets in this process must not outlive the test.
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    found = {}
    demo = actions.IncludeLaunchDescription(
        sources.PythonLaunchDescriptionSource(str(SHARE / "launch" / "demo.launch.py")),
        launch_arguments={k: str(v) for k, v in arguments.items()}.items(),
    )
    watch = handlers.OnProcessExit(
        on_exit=lambda event, _: found.update(
            {event.process_name.rsplit("-", 1)[0]: event.returncode}
        )
    )
    service = launch.LaunchService()
    service.include_launch_description(
        launch.LaunchDescription([actions.RegisterEventHandler(watch), demo])
    )
    assert service.run() == status
    return found


@pytest.mark.timeout(60)
def test_demo_ends_with_a_tracker_that_cannot_start(tmp_path, monkeypatch):
    path = tmp_path / "bad.yaml"
    path.write_text(BAD)
    found = ended({"params_file": path, "out": tmp_path / "out"}, monkeypatch, status=1)
    assert found["tracker"] == 2
    # Ended with it, and the replay was never started.
    assert {*found} == {"tracker", "evaluator"}


@pytest.mark.timeout(60)
def test_demo_ends_after_a_bag_without_truth(tmp_path, monkeypatch):
    shipped = BagReader(SHARE / "bags" / "paper_scenario")
    topics = [names.detections(radar) for radar in ("radar_1", "radar_2")]
    first = islice(shipped.messages(topics), 10)
    bag = write(tmp_path / "bag", topics, [(m.topic, m.data, m.log_time_ns) for m in first])
    found = ended({"bag": bag, "out": tmp_path / "out"}, monkeypatch)
    assert found == {"tracker": 0, "evaluator": 0, "sensor_replay": 0}


@pytest.mark.timeout(60)
def test_demo_starts_nothing_with_a_rate_that_the_replay_would_refuse(tmp_path, monkeypatch):
    given = {"rate": "-1", "out": tmp_path / "out"}
    assert ended(given, monkeypatch, status=1) == {}


@pytest.mark.timeout(60)
def test_demo_fails_if_its_replay_fails(tmp_path, monkeypatch):
    whole = next((SHARE / "bags" / "paper_scenario").glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    found = ended({"bag": cut, "out": tmp_path / "out"}, monkeypatch, status=1)
    assert found["sensor_replay"] == 3
