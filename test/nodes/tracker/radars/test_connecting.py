"""What the page on connecting a radar does where there is no `ros2` command."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2

from msg_adapters.incoming import detections
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.core.types import Detections

TEXT = (Path(__file__).parents[4] / "docs" / "connect_your_radar.md").read_text()
TOPIC = "/radar_1/detections"


@pytest.fixture
def look(tmp_path):
    """Start the page's script; return the file of its output."""
    (script,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    path, log = tmp_path / "look.py", tmp_path / "look.log"
    path.write_text(script)
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [sys.executable, "-u", path, TOPIC],
            stdout=stream,
            stderr=subprocess.STDOUT,
            env=os.environ,
        )
    yield log
    process.kill()
    process.wait()


def test_script_of_the_page_shows_topics_clouds_and_diagnostics(radars, look, peer):
    def logged(pattern):
        found = re.compile(pattern, re.MULTILINE)
        return peer.spin_until(lambda: found.search(look.read_text()))

    assert logged(rf"^{TOPIC} sensor_msgs/msg/PointCloud2$"), look.read_text()
    assert peer.spin_until(lambda: radars.outputs[0].get_subscription_count() == 2)
    # The script asks for best effort: what is published before it has found the publisher is lost.
    seen = re.compile(r"^\d+\.\d{9} radar_1: \d+ x .*range azimuth", re.MULTILINE)
    for index in range(60):
        radars.track(index)
        if peer.spin_until(lambda: seen.search(look.read_text()), 0.2):
            break
    assert seen.search(look.read_text()), look.read_text()
    assert logged(rf"tracker: radar_1: .* received={index + 1} "), look.read_text()


def test_evaluator_records_as_on_the_page_without_truth_and_tracker(processes, peer, tmp_path):
    (line,) = re.findall(r"-m phd_jdtc_ros evaluator (.*record:=.*)$", TEXT, re.MULTILINE)
    words = line.replace("my_recording", str(tmp_path / "bag")).replace("/your/topic", TOPIC)
    evaluator = processes.start("evaluator", *shlex.split(words))
    driver = peer.publisher(PointCloud2, TOPIC)
    assert peer.spin_until(lambda: driver.get_subscription_count() == 1)
    many = Detections(np.ones((20_000, 2)), np.full(20_000, 5.0))
    sent = 0

    def written():
        nonlocal sent
        sent += 1
        driver.publish(detections.to_msg(many, sent, "radar_1"))
        return any(file.stat().st_size > 1_000_000 for file in (tmp_path / "bag").glob("*.mcap"))

    assert peer.spin_until(written)
    evaluator.send_signal(signal.SIGINT)

    assert evaluator.wait(20.0) == 0
    assert 0 < BagReader(tmp_path / "bag").counts[TOPIC] <= sent
