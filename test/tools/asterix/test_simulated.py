"""The simulated hours as ASTERIX: decoded again, they are as real recordings look."""

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from phd_jdtc_ros import resources
from phd_jdtc_ros.asterix import plot_stream
from phd_jdtc_ros.asterix.messages import NONE, NORTH, SECTOR, Plot
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.types import UNKNOWN
from phd_jdtc_ros.simulation import antenna
from phd_jdtc_ros.simulation.turning_antenna import plots_with_replies
from phd_jdtc_ros.tools import simulate
from phd_jdtc_ros.tools.asterix import writing as simulated_asterix
from phd_jdtc_ros.transport import pcap
from studies.hours import study as hours

MINUTES = {"approach_hour": 3.0, "en_route_hour": 4.0}
TICK_S = 1.0 / 128.0


class Recorded:
    """A part of an hour, simulated and decoded again."""

    def __init__(self, name, directory, seed=3):
        self.hour, self.config, self.document = hours.hour_of(name, MINUTES[name], seed)
        self.path = directory / hours.RECORDINGS[name]
        hours.record(self.hour, self.config, self.document, self.path)
        self.counts = Counter()
        data = self.path.read_bytes()
        if pcap.is_capture(data[:4]):
            sent = [(each.received_ns, each.data) for each in pcap.packets(data, self.counts)]
        else:
            sent = [(None, data)]
        self.received, self.messages = [], []
        for received_ns, block in sent:
            found = list(plot_stream.BlockReader(self.counts).messages(block))
            self.messages += found
            self.received += [received_ns] * len(found)
        rows = [k for k, each in enumerate(self.messages) if isinstance(each, Plot)]
        self.plots = [self.messages[k] for k in rows]
        self.plots_received = [self.received[k] for k in rows]
        self.own, self.answers = plots_with_replies(self.hour.turning, seed)
        self.time_s = self.hour.turning.times_at(self.own.revolutions)

    def column(self, name):
        return np.array([getattr(plot, name) for plot in self.plots])


@pytest.fixture(scope="module")
def approach(tmp_path_factory):
    return Recorded("approach_hour", tmp_path_factory.mktemp("approach"))


@pytest.fixture(scope="module")
def en_route(tmp_path_factory):
    return Recorded("en_route_hour", tmp_path_factory.mktemp("en_route"))


def test_recording_has_the_simulated_plots_to_their_resolution(approach):
    assert not approach.counts
    count = len(approach.plots)
    # Plots of the last sector, which the antenna has not left, are not sent.
    assert 0 <= len(approach.time_s) - count < 60
    answers = approach.answers.take(np.arange(count))
    seconds = approach.column("time_of_day") * TICK_S
    np.testing.assert_allclose(seconds - 36000.0, approach.time_s[:count], atol=TICK_S)
    distance, azimuth = answers.measurement.T
    np.testing.assert_allclose(approach.column("distance"), distance, atol=1852.0 / 512 + 1e-6)
    off = np.angle(np.exp(1j * (0.5 * math.pi - azimuth - approach.column("azimuth"))))
    assert np.abs(off).max() <= math.pi / 2**16 + 1e-9
    np.testing.assert_allclose(approach.column("height"), answers.height + 100.0, atol=3.82)
    for name in ("code", "address"):
        own = getattr(answers, name)
        known = np.where(own == UNKNOWN, NONE, own)
        np.testing.assert_array_equal(approach.column(name), known)


def test_approach_radar_sends_some_plots_a_block_and_no_antenna_messages(approach):
    assert len(approach.plots) == len(approach.messages)
    data, at, sizes = approach.path.read_bytes(), 0, []
    while at < len(data):
        length = int.from_bytes(data[at + 1 : at + 3], "big")
        sizes.append(len(list(plot_stream.BlockReader(Counter()).messages(data[at : at + length]))))
        at += length
    assert max(sizes) == 10
    assert 5.0 < np.mean(sizes) < 10.0


def test_capture_times_plots_of_a_wrong_clock(en_route):
    received = np.array(en_route.plots_received) * 1e-9
    own = en_route.column("time_of_day") * TICK_S
    # The clock is ahead; a plot comes 0.3 s after the antenna has left its sector of 0.375 s.
    late = received - 1772445600.0 - (own - 36000.0 - 1581.0)
    assert 0.29 < late.min() < 0.32
    assert 0.64 < late.max() < 0.69
    assert (en_route.column("address") == NONE).all()
    assert np.mean(en_route.column("code") != NONE) > 0.8


def test_en_route_radar_reports_each_sector_at_once(en_route):
    services = [
        (received * 1e-9, each)
        for received, each in zip(en_route.received, en_route.messages, strict=True)
        if not isinstance(each, Plot)
    ]
    kinds = Counter(each.kind for _, each in services)
    assert set(kinds) == {NORTH, SECTOR}
    assert kinds[NORTH] == 20
    azimuth = np.array([each.azimuth for _, each in services])
    np.testing.assert_allclose(np.mod(np.diff(azimuth), 2.0 * math.pi), 2.0 * math.pi / 32)
    own = np.array([each.time_of_day for _, each in services]) * TICK_S
    late = (
        np.array([received for received, _ in services]) - 1772445600.0 - (own - 36000.0 - 1581.0)
    )
    np.testing.assert_allclose(late, 0.02, atol=0.01)


def test_recording_of_a_seed_is_always_the_same(en_route, tmp_path):
    assert Recorded("en_route_hour", tmp_path).path.read_bytes() == en_route.path.read_bytes()
    other = tmp_path / "other"
    other.mkdir()
    assert Recorded("en_route_hour", other, 4).path.read_bytes() != en_route.path.read_bytes()


def test_radar_that_does_not_turn_sends_no_asterix(tmp_path, capsys):
    path = tmp_path / "sent.ast"
    status = simulate.main(["--out", str(tmp_path / "bag"), "--asterix", str(path)])
    assert status == 2
    assert "radar_1.rotation_s: 0 given, must be above 0" in capsys.readouterr().err
    assert not path.exists()
    assert not (tmp_path / "bag").exists()


def test_simulate_names_an_impossible_recording_before_it_simulates(tmp_path, capsys):
    missing, taken = tmp_path / "none" / "sent.ast", tmp_path / "sent.ast"
    taken.write_bytes(b"mine")
    scenario = str(resources.find(Path("config/scenarios/en_route_hour.yaml")))
    faults = {
        missing: f"--asterix: {missing} given, but {missing.parent} is no directory",
        taken: f"--asterix: {taken} already exists, a file is not overwritten",
    }
    for path, fault in faults.items():
        given = ["--scenario", scenario, "--out", str(tmp_path / "bag"), "--asterix", str(path)]
        assert simulate.main(given) == 2
        assert fault in capsys.readouterr().err
    assert taken.read_bytes() == b"mine"
    assert not (tmp_path / "bag").exists()


def test_sending_names_what_is_wrong(en_route):
    radars, faults = en_route.hour.scenario.radars, []
    given = {"sending": {"en_route": {"plots": 0, "line": 1}, "other": {}}}
    assert len(antenna.read_sending(given, radars, faults)) == 1
    assert [fault.split(":")[0] for fault in faults] == [
        "sending.other",
        "sending.en_route.line",
        "sending.en_route.plots",
    ]


def test_capture_is_chosen_by_the_name_of_the_file(en_route, tmp_path):
    raw = tmp_path / "raw.ast"
    hours.record(en_route.hour, en_route.config, en_route.document, raw)
    assert Path(hours.RECORDINGS["en_route_hour"]).suffix == simulated_asterix.CAPTURE
    with pytest.raises(ConfigError):
        hours.record(en_route.hour, en_route.config, {"sending": {"other": {}}}, raw)
    assert list(plot_stream.BlockReader(Counter()).messages(raw.read_bytes())) == en_route.messages
