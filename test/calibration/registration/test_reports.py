"""Registration of one radar alone, with aircraft that report themselves as the reference."""

import json
from pathlib import Path

import pytest

from phd_jdtc_ros.__main__ import run
from phd_jdtc_ros.parameter_files import yaml_files

ROOT = Path(__file__).parents[3]
RANGE, AZIMUTH_DEG = 60.0, 0.15


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return five minutes of a biased radar and a receiver of ADS-B."""
    document = yaml_files.load(ROOT / "config" / "scenarios" / "approach_adsb.yaml")
    document["scans"] = 76
    directory = tmp_path_factory.mktemp("reports")
    path = directory / "scenario.yaml"
    path.write_text(json.dumps(document))
    out = directory / "bag"
    words = ["--scenario", str(path), "--seed", "6", "--out", str(out)]
    assert run("simulate", words) == 0
    return out


def test_biases_of_one_radar_are_found_with_its_receiver(bag, tmp_path):
    out = tmp_path / "registered.yaml"
    assert run("register", [str(bag), "--out", str(out)]) == 0
    own = yaml_files.load(out)["/**/tracker"]["ros__parameters"]
    range_bias, _, azimuth_deg, _ = own["west"]["biases"]
    assert range_bias == pytest.approx(RANGE, abs=15.0)
    # Azimuths of this radar count counter-clockwise.
    assert azimuth_deg == pytest.approx(-AZIMUTH_DEG, abs=0.01)
