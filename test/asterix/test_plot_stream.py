import copy
import itertools
import math

import asterix_records as made
import numpy as np
import pytest

from phd_jdtc_ros.asterix.assembly import SectorReport
from phd_jdtc_ros.asterix.messages import DAY, Plot
from phd_jdtc_ros.asterix.plot_stream import MAX_RADARS, PlotStream, RadarSettings
from phd_jdtc_ros.asterix_bridge.clouds import columns
from phd_jdtc_ros.core.intake.sectors import coverage_of
from phd_jdtc_ros.transponders.stream import UNKNOWN

NS = 10**9
SEEN = [(10.0, 20.0), (100.0, 30.0), (190.0, 40.0), (350.0, 50.0)]


def plot(azimuth_deg=0.0, **changes):
    return Plot(1, 0, DAY, 1000.0, math.radians(azimuth_deg), **changes)


def of(*plots, sector=0, sectors=32):
    report = SectorReport(1000, sector, [1000] * len(plots), list(plots))
    return columns(report, sectors)


def ended(stream, found):
    """Return what was found and what is left at the end."""
    return found + [(state.settings.name, report) for state, report in stream.finish()]


def fed(stream, datagrams, source=None, received_s=None):
    received_ns = None if received_s is None else round(received_s * NS)
    return [
        (state.settings.name, report)
        for data in datagrams
        for state, report in stream.feed(data, received_ns, source)
    ]


@pytest.mark.parametrize(
    ("compass", "azimuth"),
    [(0.0, 90.0), (90.0, 0.0), (180.0, -90.0), (270.0, 180.0), (359.0, 91.0), (271.0, 179.0)],
)
def test_azimuth_is_counter_clockwise_from_east(compass, azimuth):
    found = of(plot(compass))
    assert math.degrees(found["azimuth"][0]) == pytest.approx(azimuth)
    east, north = math.sin(math.radians(compass)), math.cos(math.radians(compass))
    assert (found["x"][0], found["y"][0]) == pytest.approx((1000.0 * east, 1000.0 * north))


@pytest.mark.parametrize("sectors", [4, 16, 32])
def test_sector_is_that_of_the_same_azimuths_counted_from_east(sectors):
    for number in range(sectors):
        middle = (number + 0.5) * 360.0 / sectors
        found = of(plot(middle), sector=number, sectors=sectors)
        coverage = coverage_of(int(found["sector"][0]), sectors, compass=False)
        ahead = (found["azimuth"][0] - coverage.start) % (2.0 * math.pi)
        assert ahead == pytest.approx(0.5 * coverage.width)


def test_amplitude_is_the_envelope_over_the_noise():
    # 20 dB over the noise: a = sqrt(2 * 100).
    known = plot(primary_dbm=-80.0, secondary_dbm=-50.0)
    replies = plot(secondary_dbm=-70.0)
    found = of(known, replies, plot())["amplitude"]
    np.testing.assert_allclose(found, [math.sqrt(200.0), math.sqrt(2000.0), math.nan], rtol=1e-12)


def test_unknown_values_are_written_as_unknown():
    found = of(plot(), plot(code=0, address=1, height=-304.8))
    assert found["code"].tolist() == [UNKNOWN, 0]
    assert found["address"].tolist() == [UNKNOWN, 1]
    np.testing.assert_array_equal(found["height"], [math.nan, -304.8])
    assert found["kind"].dtype == np.uint8


def test_radars_on_one_stream_have_sectors_of_their_own():
    one = [*made.revolutions(2, seen=SEEN, sic=1)]
    other = [*made.revolutions(2, sectors=16, rotation_s=5.0, seen=SEEN[:2], sic=2)]
    stream = PlotStream({0x101: RadarSettings("a"), 0x102: RadarSettings("b", sectors=16)})
    mixed = [data for pair in zip(one, other, strict=False) for data in pair]
    found = ended(stream, fed(stream, [*mixed, *one[len(other) :]]))
    for name, data, sectors, count in (("a", one, 32, 8), ("b", other, 16, 4)):
        own = [report for each, report in found if each == name]
        apart = PlotStream({}, RadarSettings("", sectors=sectors))
        alone = ended(apart, fed(apart, data))
        assert own == [report for _, report in alone]
        assert sum(len(report.plots) for report in own) == count


def test_unnamed_radars_are_left_out_or_numbered_and_bounded():
    data = [*made.revolutions(1, sac=25, sic=13)]
    stream = PlotStream({0x101: RadarSettings("a")})
    assert fed(stream, data) == []
    assert stream.counts == {"unknown_radar": 33}
    stream = PlotStream({})
    assert {name for name, _ in fed(stream, data)} == {"radar_25_13"}
    stream = PlotStream({})
    for number in range(MAX_RADARS + 20):
        stream.feed(made.north(5.0, sac=number // 256, sic=number % 256))
    assert len(stream.radars) == MAX_RADARS
    assert stream.counts == {"too_many_radars": 20}


def test_second_source_of_a_radar_is_left_out_while_the_first_sends():
    data = [*made.revolutions(2, seen=SEEN)]
    alone = fed(PlotStream({}), data, "a", 1000.0)
    stream = PlotStream({})
    both = []
    for each in data:
        both += fed(stream, [each], "a", 1000.0)
        both += fed(stream, [each], "b", 1000.0)
    assert both == alone
    (state,) = stream.radars.values()
    assert state.counts["second_source"] == len(data)
    assert state.other_source == "b"


def test_radar_whose_messages_give_another_place_keeps_the_first_and_counts_them():
    places = [(50.0, 8.0, 100), (50.0001, 8.0001, 110), (49.9, 8.5, 90), (49.9, 8.5, 90)]
    stream = PlotStream({})
    fed(stream, [made.site(*place) for place in places])
    (state,) = stream.radars.values()
    assert state.site == pytest.approx(places[0], abs=1e-4)
    assert state.other_site == pytest.approx(places[-1], abs=1e-4)
    assert state.counts["second_place"] == 2
    # What is configured stands against all messages.
    stream = PlotStream({0x102: RadarSettings("a", site=(48.0, 9.0, 0.0))})
    fed(stream, [made.site(*place) for place in places])
    assert stream.radars[0x102].site == (48.0, 9.0, 0.0)
    assert not stream.radars[0x102].counts["second_place"]


def test_second_source_takes_over_when_the_first_is_silent():
    stream = PlotStream({})
    fed(stream, made.revolutions(1, start_s=1000.0), "a", 1000.0)
    fed(stream, made.revolutions(1, start_s=1020.0), "b", 1020.0)
    (state,) = stream.radars.values()
    assert state.counts["source_changed"] == 1
    assert state.counts["second_source"] == 0
    assert set(state.sources.values()) == {"b"}


def test_plots_and_crossings_may_come_from_different_sources():
    stream = PlotStream({})
    found = []
    for data in made.revolutions(2, seen=SEEN):
        found += fed(stream, [data], "plots" if data[0] == 48 else "service", 1000.0)
    found = ended(stream, found)
    assert sum(len(report.plots) for _, report in found) == 8
    assert len(found) == 64


def test_first_messages_of_a_wrong_clock_have_the_shift_of_all():
    stream = PlotStream({})
    found = []
    for k, data in enumerate(made.revolutions(3, start_s=1000.0, seen=SEEN)):
        found += fed(stream, [data], received_s=2581.0 + 4.0 * k / 35.0)
    stamps = np.array([report.stamp_ns for _, report in ended(stream, found)])
    np.testing.assert_array_equal(np.diff(stamps), NS // 8)
    (state,) = stream.radars.values()
    assert state.assembler.revolution_s == pytest.approx(4.0)
    assert state.counts["clock_off"] == 1
    assert state.clock.shift_ns == pytest.approx(1581 * NS, abs=NS)


def test_messages_that_wait_for_the_clock_are_not_lost_at_the_end():
    stream = PlotStream({})
    fed(stream, [made.plots(made.plot(10.0, 1000.0))], received_s=5000.0)
    ((_, report),) = ended(stream, [])
    assert report.times_ns == [5000 * NS]


def test_radar_position_is_the_reported_one_or_else_the_configured_one():
    said = made.site(50.25, -8.5, 120.0)
    stream = PlotStream(
        {0x102: RadarSettings("a"), 0x103: RadarSettings("b", site=(1.0, 2.0, 3.0))}
    )
    fed(stream, [said, made.site(50.25, -8.5, 120.0, sic=3)])
    assert stream.radars[0x102].site == pytest.approx((50.25, -8.5, 120.0), abs=1e-4)
    assert stream.radars[0x103].site == (1.0, 2.0, 3.0)


def passing(sectors, delay_s, revolutions=6, revolution_s=4.0):
    """Return the time of each message, seconds, with its data, as they are sent.

    Plots are sent so much after the antenna has passed them. Without sectors there are only plots.
    """
    first_s = 1000.0
    sent = [
        (time_s + delay_s, time_s, made.plots(made.plot(time_s * 90.0 % 360.0, time_s)))
        for time_s in first_s + np.arange(0.05, revolutions * revolution_s, 0.17)
    ]
    sent += [
        (time_s, time_s, made.sector((time_s - first_s) * 90.0 % 360.0, time_s))
        for time_s in first_s + np.arange(revolutions * sectors) * revolution_s / max(sectors, 1)
    ]
    return [(time_s, data) for _, time_s, data in sorted(sent)]


@pytest.mark.parametrize("delay_s", [0.0, 0.3])
@pytest.mark.parametrize("sectors", [32, 4, 0])
def test_stream_may_stop_anywhere(sectors, delay_s):
    messages = passing(sectors, delay_s)
    stream, before = PlotStream({}), []
    # After the stop of a radar without sectors its last slice is sent before it is over.
    open_s = 0.0 if sectors else 0.25
    for number, (_, data) in enumerate(messages):
        before += fed(stream, [data])
        if number < len(messages) - 80:
            continue
        paused = copy.deepcopy(stream)
        last = ended(paused, [])
        reports = [report for _, report in before + last]
        latest_s = max(time_s for time_s, _ in messages[: number + 1])
        stamps_s = [report.stamp_ns / NS for report in reports]
        assert all(a < b for a, b in itertools.pairwise(stamps_s))
        assert stamps_s[-1] <= latest_s + open_s + 1 / 128
        times_s = sorted(time_ns / NS for report in reports for time_ns in report.times_ns)
        plots_s = [time_s for time_s, data in messages[: number + 1] if data[0] == 48]
        assert times_s == pytest.approx(plots_s, abs=1 / 128)
        for _, report in last:
            assert (report.sector is not None) == bool(sectors)
            assert all(abs(time - report.stamp_ns) < 1.5 * NS for time in report.times_ns)
            if sectors:
                numbers = {int(each.azimuth / math.tau * 32 + 1e-9) for each in report.plots}
                assert numbers <= {report.sector}
        # The stream goes on after the stop, with nothing lost or sent twice.
        after = ended(paused, fed(paused, [data for _, data in messages[number + 1 :]]))
        stamps_s += [report.stamp_ns / NS for _, report in after]
        assert all(a < b for a, b in itertools.pairwise(stamps_s))
        plots = sum(len(report.plots) for _, report in before + last + after)
        assert plots == sum(data[0] == 48 for _, data in messages)


@pytest.mark.parametrize("category", range(256))
def test_a_block_without_a_record_has_no_report_and_ends_nothing(category):
    stream = PlotStream({})
    assert not stream.feed(bytes([category, 0, 3]), 10**18, "radar to group")
    assert not stream.radars
