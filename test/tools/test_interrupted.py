"""What executables leave when a service manager or a keyboard ends them."""

import signal
import subprocess
import sys
import time

import pytest
import yaml

from msg_adapters.encoding import names
from phd_jdtc_ros.bags.reader import BagReader

# Far more scans than are written before the signal.
LONG = "interval_s: 6.0\nscans: 4000\ntargets: []\n"


@pytest.mark.parametrize(
    ("name", "number"), [("simulate", signal.SIGTERM), ("track_bag", signal.SIGINT)]
)
def test_interrupted_tool_completes_its_bag(tmp_path, name, number):
    out, scenario = tmp_path / "out", tmp_path / "long.yaml"
    scenario.write_text(LONG)
    words = {
        "simulate": ["--scenario", scenario],
        "track_bag": ["paper_scenario", "-p", "engine:=phd", "-p", "particles:=[5000]"],
    }[name]
    process = subprocess.Popen(
        [sys.executable, "-m", "phd_jdtc_ros", name, *words, "--out", out],
        stderr=subprocess.PIPE,
        text=True,
    )
    file, deadline = out / "out_0.mcap", time.monotonic() + 60.0
    while not (file.exists() and file.stat().st_size > 20_000) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(number)
    _, said = process.communicate(timeout=30.0)

    assert process.returncode == 130
    assert said.splitlines()[-1] == f"{name}: interrupted"
    assert "Traceback" not in said
    document = yaml.safe_load((out / "metadata.yaml").read_text())
    counted = document["rosbag2_bagfile_information"]["message_count"]
    bag = BagReader(out)
    read = [entry.topic for entry in bag.messages()]
    assert len(read) == counted
    assert read.count(names.detections("radar_1")) >= 5
