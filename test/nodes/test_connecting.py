# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page on connecting a radar does where there is no `ros2` command."""

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from test_tracker import Radars, radars  # noqa: F401, a fixture

from phd_jdtc_ros.bags.reader import BagReader

TEXT = (Path(__file__).parents[2] / "docs" / "connect_your_radar.md").read_text()
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


def test_script_of_the_page_shows_topics_clouds_and_diagnostics(radars, look, peer):  # noqa: F811
    def said(pattern):
        found = re.compile(pattern, re.MULTILINE)
        return peer.spin_until(lambda: found.search(look.read_text()))

    assert said(rf"^{TOPIC} sensor_msgs/msg/PointCloud2$"), look.read_text()
    assert peer.spin_until(lambda: radars.outputs[0].get_subscription_count() == 2)
    for index in range(3):
        radars.track(index)
    assert said(r"^\d+\.\d{9} radar_1: \d+ x .*range azimuth"), look.read_text()
    assert said(r"tracker: radar_1: .* received=3 "), look.read_text()


def test_evaluator_records_as_on_the_page_without_truth_and_tracker(processes, peer, tmp_path):
    (line,) = re.findall(r"-m phd_jdtc_ros evaluator (.*record:=.*)$", TEXT, re.MULTILINE)
    words = line.replace("my_bag", str(tmp_path / "bag")).replace("/your/topic", TOPIC)
    evaluator = processes.start("evaluator", *shlex.split(words))
    driver = Radars(peer)
    assert peer.spin_until(lambda: driver.outputs[0].get_subscription_count() == 1)
    for index in range(3):
        driver.send(index)
    assert peer.spin_until(driver.outputs[0].wait_for_all_acked)
    evaluator.send_signal(signal.SIGINT)

    assert evaluator.wait(20.0) == 0
    assert BagReader(tmp_path / "bag").counts[TOPIC] == 3
