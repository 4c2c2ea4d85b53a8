import math
from collections import Counter

import asterix_records as made
import pytest
from asterix_reference import decoded, value

from phd_jdtc_ros.asterix import blocks
from phd_jdtc_ros.asterix.messages import DAY, NONE, Plot
from phd_jdtc_ros.asterix.writing import plots as plots_out

NS = 10**9


def random_plot(rng):
    known = rng.random(6) < 0.7
    return Plot(
        int(rng.integers(2**16)),
        NONE,
        DAY,
        float(rng.uniform(0.0, 4e5)),
        float(rng.uniform(-7.0, 7.0)),
        float(rng.integers(-40, 1600)) * 7.62 if known[0] else math.nan,
        int(rng.integers(2**12)) if known[1] else NONE,
        int(rng.integers(1, 2**24)) if known[2] else NONE,
        int(rng.integers(1, 8)),
        float(rng.integers(-120, 20)) if known[3] else math.nan,
        float(rng.integers(-120, 20)) if known[4] else math.nan,
    )


def test_plots_are_read_again_to_their_resolution():
    rng, counts = made.rng(3), Counter()
    plots = [(int(rng.integers(86_400 * NS)), random_plot(rng)) for _ in range(100)]
    data = b"".join(plots_out.plot_blocks(plots))
    found = list(blocks.BlockReader(counts).messages(data))
    assert not counts
    for (time_ns, plot), again, record in zip(plots, found, decoded(data), strict=True):
        assert again.time_of_day == pytest.approx(time_ns * 128 / NS, abs=0.5001)
        assert again.distance == pytest.approx(plot.distance, abs=1852.0 / 512)
        off = math.remainder(again.azimuth - plot.azimuth, 2.0 * math.pi)
        assert abs(off) <= math.pi / 2**16 + 1e-12
        rest = again._replace(time_of_day=NONE, distance=plot.distance, azimuth=plot.azimuth)
        assert rest == pytest.approx(plot, nan_ok=True)
        assert value(record, "I040", "RHO") == again.distance / 1852.0


def test_antenna_reports_crossings_of_north_and_other_azimuths():
    counts = Counter()
    for azimuth, kind in ((0.0, 1), (2.0 * math.pi, 1), (-math.pi, 2), (math.pi / 2, 2)):
        data = plots_out.service_block(0x1907, 5 * NS, azimuth, 4.0)
        (found,) = blocks.BlockReader(counts).messages(data)
        assert (found.radar, found.time_of_day, found.kind) == (0x1907, 640, kind)
        assert found.azimuth == pytest.approx(azimuth % (2.0 * math.pi))
        assert found.rotation_s == 4.0
        (record,) = decoded(data)
        assert value(record, "I000", "MsgTyp") == kind
    assert not counts


def test_turn_that_is_not_known_is_left_out():
    (found,) = blocks.BlockReader(Counter()).messages(plots_out.service_block(1, 0, 0.0, 0.0))
    assert math.isnan(found.rotation_s)
