"""Input whose cost might grow faster than its size: seams, repetitions, names, forged times."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msg_adapters.encoding import names
from msg_adapters.incoming.detections import OWN_LAYOUT, from_msg, to_msg
from phd_jdtc_ros.asterix import writing as plots_out
from phd_jdtc_ros.asterix.assembly import SectorReport
from phd_jdtc_ros.asterix.messages import DAY, NONE, PRIMARY, Plot
from phd_jdtc_ros.asterix.plot_stream import PlotStream
from phd_jdtc_ros.asterix_bridge import configuration
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.calibration.tuning.plots import PlotRevolutions
from phd_jdtc_ros.configuration.engines import new_pipeline
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.core.intake.scans import Rejection
from phd_jdtc_ros.core.pipeline import Stepped
from phd_jdtc_ros.core.tracks.region import Region
from phd_jdtc_ros.core.types import Detections, Estimates
from phd_jdtc_ros.handover.ownership import Handover
from phd_jdtc_ros.parameter_files import from_arguments
from phd_jdtc_ros.tools.asterix import bridge
from phd_jdtc_ros.transport import pcap

from ..harness import scans
from ..harness.figures import Found, in_own_process, measures, peak_mb, such_as

NS = scans.SECOND_NS
DAY_NS = 20_779 * 86_400 * NS
REGIONS = (Region(-1e5, -1e5, 0.0, 1e5, 1e4), Region(0.0, -1e5, 1e5, 1e5, 1e4))
TARGETS = 3000
COPIES, COPIED, SCANS = 500, range(5, 8), 32
NAMES = 3000
RADAR, ROTATION_S, SECTORS, FORGED = 0x0101, 4.0, 32, 500


@measures(
    "targets at the seam of hand_over",
    f"{TARGETS} + {TARGETS} in the margins: 0.5 s of CPU a stamp, 256 MB",
)
def measure_seam() -> Found:
    """Join two trackers with very many targets where their margins overlap."""
    found = {spread: in_own_process(join, spread) for spread in (9000.0, 300.0, 0.0)}
    step_s = max(each["step_s"] for each in found.values())
    memory_mb = max(each["memory_mb"] for each in found.values())
    text = f"{step_s:.2f} s of CPU a stamp, +{memory_mb:.0f} MB"
    details = {f"within {spread:g} m": each for spread, each in found.items()}
    return text, step_s <= 0.5 and memory_mb <= 256.0, details


def join(spread: float) -> dict[str, float]:
    """Return the largest CPU time of a stamp, and the memory of a few stamps.

    `spread` is the largest distance of the targets from the seam, metres.
    """
    rng = np.random.default_rng(0)
    place = rng.uniform(-spread, spread, (TARGETS, 2))
    handover = Handover(REGIONS, 2e3)
    # The first call loads SciPy, and is not measured.
    handover.add({k: _tracks(0, place[:2]) for k in range(2)})
    before, step_s = peak_mb(), 0.0
    for stamp in range(1, 5):
        both = {k: _tracks(stamp, place + rng.normal(0.0, 20.0, place.shape)) for k in range(2)}
        begin_s = time.process_time()
        handover.add(both)
        step_s = max(step_s, time.process_time() - begin_s)
    return {"step_s": step_s, "memory_mb": peak_mb() - before}


def _tracks(stamp: int, place: np.ndarray[Any, Any]) -> Estimates:
    count = len(place)
    state = np.zeros((count, 5))
    state[:, [0, 2]] = place
    return Estimates(
        stamp_ns=stamp * NS,
        lag=0,
        state=state,
        covariance=np.tile(np.diag([2500.0, 1.0, 2500.0, 1.0, 1e-6]), (count, 1, 1)),
        weight=np.ones(count),
        class_probability=np.ones((count, 1)),
        class_id=np.zeros(count, dtype=np.int64),
        track_id=np.arange(1, count + 1),
    )


@measures(
    "identical detections",
    f"{len(COPIED)} scans of {COPIES} copies: 1 target, never lost, every copy counted",
)
def measure_repeated() -> Found:
    """Track a target of a radar whose driver repeats its buffer many times in some scans."""
    given = from_arguments.load(scans.PROFILE)
    of_one = {name: value for name, value in given.items() if not name.startswith("radar_2.")}
    config = from_arguments.config_of({**of_one, "sensors": ["radar_1"]})
    pipeline, targets, counted = new_pipeline(config), [], 0
    for scan in range(SCANS):
        copies = COPIES if scan in COPIED else 1
        seen = Detections(np.tile([5e3, 0.5], (copies, 1)), np.full(copies, 20.0))
        stamp_ns = DAY_NS + round(scan * config.model.modes.interval_s * NS)
        report = from_msg(to_msg(seen, stamp_ns, ""), OWN_LAYOUT)
        counted += report.anomalies["detections_repeated"]
        events = pipeline.add(0, report.stamp_ns, report.detections)
        if isinstance(events, Rejection):
            raise RuntimeError(f"scan {scan} was not used: {events.value}")
        for event in events:
            if isinstance(event, Stepped):
                targets += [len(own) for own in event.step.filtered]
    late = targets[min(COPIED) - 1 :]
    lost = sum(count == 0 for count in late)
    wanted = len(COPIED) * (COPIES - 1)
    text = (
        f"{max(targets)} targets, {lost} scans of {len(late)} without, {counted:,} copies counted"
    )
    reached = max(targets) == 1 and not lost and counted == wanted
    return text, reached, {"targets": targets, "counted": counted}


@measures("long lists of names", f"{NAMES} in each list: refused or accepted in 2 s of CPU")
def measure_names() -> Found:
    """Configure lists of very many names; their faults must be reported quickly."""
    seconds = {}
    for group in ("classes", "motions", "births", "sensors", "shared_codes"):
        for with_sections in (False, True):
            names = [f"n{index}" for index in range(NAMES)]
            given: dict[str, Any] = {group: names}
            if with_sections:
                given |= {f"{name}.motions": ["cv"] for name in names}
            begin_s = time.process_time()
            try:
                from_arguments.config_of(given)
                outcome = "accepted"
            except ConfigError as error:
                outcome = error.faults[0][:60]
            key = f"{group}{' with sections' * with_sections}: {outcome}"
            seconds[key] = time.process_time() - begin_s
    longest_s = max(seconds.values())
    return f"{longest_s:.2f} s", longest_s <= 2.0, {"seconds": seconds}


@measures(
    "captures with forged times",
    "a whole bag, all real plots used, the true revolution, no empty sector more, counted",
)
def measure_forged_times() -> Found:
    """Read captures with forged times of records and of plots."""
    wrong = _forged_record_times()
    found = {}
    for name, (crossings, sector, times_ns) in _forgeries().items():
        stream = PlotStream({}, finders=PlotRevolutions)
        empty = 0
        for data, received_ns in _datagrams(crossings, sector, times_ns):
            sent = (report for _, report in stream.feed(data, received_ns))
            empty += sum(isinstance(each, SectorReport) and not each.plots for each in sent)
        (state,) = stream.radars.values()
        revolution_s, off = state.assembler.revolution_s, state.counts["time_off"]
        found[name] = {"empty": empty, "revolution_s": revolution_s, "off": off}
        if abs(revolution_s / ROTATION_S - 1.0) > 0.01 or empty or off != FORGED:
            wrong[name] = str(found[name])
    text = f"{len(found) + 1} captures: {len(wrong)} wrong{such_as(wrong)}"
    return text, not wrong, {"wrong": wrong, **found}


def _forged_record_times() -> dict[str, str]:
    """Return the faults of the bag of a capture with the record times 0 and 2^32 - 1."""
    times_ns = [0, (2**32 - 1) * NS]
    line, count = pcap.Line(), 3 * SECTORS
    packets = [
        pcap.packet(times_ns[k % 2] if k < 4 else _at(k), _good(_at(k), k, True), line)
        for k in range(count)
    ]
    with tempfile.TemporaryDirectory() as directory:
        path, out = Path(directory) / "forged.pcap", Path(directory) / "bag"
        path.write_bytes(pcap.header() + b"".join(packets))
        try:
            done = bridge.convert(path, out, configuration.resolve({}), None, ())
        except Exception as error:  # Any but an error of the recording would end with a traceback
            return {"times of records": f"{type(error).__name__}: {error}"}
        clouds = sum(1 for _ in BagReader(out).messages([names.detections("radar_1_1")]))
    counted = done.stream.counts["receipt_time"]
    if done.plots != 2 * count or clouds != done.clouds or counted != 2:
        return {"times of records": f"{done.plots} plots, {clouds} clouds, {counted} counted"}
    return {}


def _forgeries() -> Mapping[str, tuple[bool, int, Sequence[int]]]:
    """Return forged plots: whether the radar sends crossings, after which sector, their times."""
    rng = np.random.default_rng(0)
    found = {}
    for crossings in (True, False):
        for sector in (0, 20 * SECTORS):
            now_ns = _at(sector)
            rising = [now_ns - (3600 + 7 * (FORGED - k)) * NS for k in range(FORGED)]
            anyhow = [now_ns - round(1e9 * off) for off in rng.uniform(60.0, 4e4, FORGED)]
            for order, times_ns in (("rising", rising), ("any", anyhow)):
                what = f"{order} times of plots, crossings {crossings}, sector {sector}"
                found[what] = crossings, sector, times_ns
    return found


def _datagrams(
    crossings: bool, sector: int, times_ns: Sequence[int]
) -> Iterator[tuple[bytes, int]]:
    """Yield a radar's datagrams and their times of receipt, with forged ones after a sector."""
    azimuths = np.random.default_rng(1).uniform(0.0, 2.0 * math.pi, len(times_ns))
    for k in range(40 * SECTORS):
        yield _good(_at(k), k, crossings), _at(k)
        if k == sector:
            for time_ns, azimuth in zip(times_ns, azimuths.tolist(), strict=True):
                yield plots_out.plot_blocks([(time_ns, _plot(azimuth))])[0], _at(k)


def _at(sector: int) -> int:
    """Return the time at which the antenna has passed a sector, counted over revolutions."""
    return DAY_NS + 36_000 * NS + round(sector / SECTORS * ROTATION_S * NS)


def _good(time_ns: int, sector: int, crossings: bool) -> bytes:
    """Return a radar's datagram of a sector: two plots, and optionally the crossing."""
    azimuth = sector / SECTORS * 2.0 * math.pi
    plots = [(time_ns - 10**7 * k, _plot(azimuth - 0.05 * k)) for k in (1, 2)]
    crossing = plots_out.service_block(RADAR, time_ns, azimuth % (2.0 * math.pi), 0.0)
    return b"".join([*plots_out.plot_blocks(plots), *([crossing] if crossings else [])])


def _plot(azimuth: float) -> Plot:
    return Plot(RADAR, NONE, DAY, 5e4, azimuth % (2.0 * math.pi), detection_type=PRIMARY)
