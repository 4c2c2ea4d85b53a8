import copy

import pytest
import yaml

from phd_jdtc_ros.study import tasks as study_tasks
from phd_jdtc_ros.tools.monte_carlo import load_study

SCENARIO = """
profile: reference
scans: 6
parameters:
  particles: [100]
  radar_1: {clutter_rate: 3.0}
targets:
  - {class_id: 0, snr_db: 45.0, position: [-10000.0, 10000.0], velocity: [36.0, -44.0],
     first_scan: 0, last_scan: 5}
  - {class_id: 1, snr_db: 25.0, position: [-10000.0, -10000.0], velocity: [36.0, 44.0],
     first_scan: 1, last_scan: 4}
"""
FEW = {"particles": [0, 64]}
STUDY = {
    "lags": [0, 2],
    "cases": {
        "quiet": {"scenario": "short.yaml", "parameters": {**FEW, "radar_2.clutter_rate": 3.0}}
    },
    "variants": {
        "corrected": {"kind": "phd"},
        "as printed": {"kind": "phd_as_printed"},
        "fewer": {"kind": "phd", "parameters": {"particles": [50]}, "lags": [0, 1]},
        "reference": {"kind": "reference"},
    },
    "goals": [
        {
            "name": "localisation",
            "case": "quiet",
            "variant": "corrected",
            "lag": 2,
            "figure": "localization",
            "at_most": 100.0,
            "relative_to": "reference",
        }
    ],
}


@pytest.fixture
def study_file(tmp_path):
    """Return a function that writes a study, changed by a function, and returns its path."""
    (tmp_path / "short.yaml").write_text(SCENARIO)

    def write(change=lambda document: None):
        document = copy.deepcopy(STUDY)
        change(document)
        path = tmp_path / "study.yaml"
        path.write_text(yaml.safe_dump(document, sort_keys=False))
        return path

    return write


@pytest.fixture
def study(study_file):
    return load_study(study_file(), {})


@pytest.fixture
def tasks(study):
    """The tasks of two runs of one variant."""
    return study_tasks.plan(study.select([], ["corrected"]), range(2)).tasks


@pytest.fixture(scope="session")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as running:
        yield running.scheduler_address
