"""The public names of the package, and what importing them brings."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import phd_jdtc_ros

ROOT = Path(__file__).parents[2]


def modules_after(code):
    """Return the packages that a new Python without ROS has loaded after a line of code."""
    hidden = "('rclpy', 'sensor_msgs', 'std_msgs', 'builtin_interfaces', 'ament_index_python')"
    script = f"import sys\nfor name in {hidden}: sys.modules[name] = None\n{code}\n"
    script += "print(*{name.split('.')[0] for name, module in sys.modules.items() if module})"
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def test_public_names_load_what_they_need_alone():
    found = modules_after("from phd_jdtc_ros import Tracker, evaluate, simulate")
    assert "numpy" in found
    assert not found & {"matplotlib", "plotly", "mcap", "rich", "numba"}
    assert not modules_after("import phd_jdtc_ros") & {"numpy", "scipy", "yaml"}


def test_public_names_are_listed_and_others_raise_as_usual():
    assert {"Tracker", "evaluate", "simulate"} <= {*phd_jdtc_ros.__all__}
    assert all(inspect.getdoc(getattr(phd_jdtc_ros, name)) for name in ("Tracker", "evaluate"))
    with pytest.raises(AttributeError, match="has no attribute 'Traker'"):
        _ = phd_jdtc_ros.Traker


def test_stable_signatures_are_these():
    signature = {
        name: list(inspect.signature(value).parameters)
        for name, value in {
            "Tracker": phd_jdtc_ros.Tracker,
            "fit": phd_jdtc_ros.Tracker.fit,
            "track": phd_jdtc_ros.Tracker.track,
            "update": phd_jdtc_ros.Tracker.update,
            "flush": phd_jdtc_ros.Tracker.flush,
            "simulate": phd_jdtc_ros.simulate,
            "evaluate": phd_jdtc_ros.evaluate,
        }.items()
    }

    assert signature == {
        "Tracker": ["parameters"],
        "fit": ["self", "detections"],
        "track": ["self", "detections", "reports"],
        "update": ["self", "time", "detections", "radar", "reports"],
        "flush": ["self"],
        "simulate": ["scenario", "seed"],
        "evaluate": ["truth", "tracks", "cutoff", "order", "times"],
    }
