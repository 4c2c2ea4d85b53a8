from pathlib import Path

import numpy as np
import pytest

from msg_adapters import interfaces, names, stamps, truth
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.simulation import scenario
from phd_jdtc_ros.tools import simulate

SHIPPED = Path(__file__).parents[2] / "bags" / "paper_scenario"
RADARS = [names.detections("radar_1"), names.detections("radar_2")]


@pytest.fixture(scope="module")
def shipped():
    return BagReader(SHIPPED)


def test_the_shipped_bag_is_the_reference_scenario_of_seed_0(tmp_path):
    config = resolve({"engine": "particles"})
    fresh = tmp_path / "paper_scenario"
    run = scenario.paper_scenario(config.model.radars)
    simulate.write_bag(fresh, run, config, 0)
    assert sorted(p.name for p in SHIPPED.iterdir()) == sorted(p.name for p in fresh.iterdir())
    for path in fresh.iterdir():
        assert (SHIPPED / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("topic", [names.TRUTH, *RADARS])
def test_the_shipped_bag_has_80_scans_6_s_apart(shipped, topic):
    found = [(stamps.of_cdr(e.data), e.log_time_ns) for e in shipped.messages([topic])]
    expected = 1_000_000_000_000 + 6_000_000_000 * np.arange(80)
    assert found == [(stamp, stamp) for stamp in expected.tolist()]


def test_the_shipped_bag_holds_the_targets_of_the_scenario(shipped):
    counts = []
    for entry in shipped.messages([names.TRUTH]):
        found = truth.from_msg(interfaces.decode(entry.data, names.CLOUD))
        assert (found.class_id == (found.track_id - 1) % 2).all()
        counts.append(found.track_id.tolist())
    assert counts == [[1, 2, 3]] * 20 + [[1, 2, 3, 4]] * 40 + [[4]] * 20
