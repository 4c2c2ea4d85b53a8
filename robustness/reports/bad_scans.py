"""Faulty scans that a tracker must reject, or of which it must drop points."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from msg_adapters.encoding import interfaces
from msg_adapters.incoming import detections
from phd_jdtc_ros.core.types import Detections

from ..harness import scans
from ..harness.figures import Found, measures
from ..harness.radars import REPLY_S, Radars
from ..harness.rig import LIGHT, Rig

LARGEST, POINTS = 2**32 - 1, 7

Change = Callable[[PointCloud2], None]


@dataclass(frozen=True)
class BadScan:
    """A faulty scan and the reason under which it must be counted."""

    name: str
    reason: str  # ``any`` if it may be counted under any reason
    # Function of a stamp. Returns the serialised cloud of the first radar.
    data: Callable[[int], bytes]
    count: int = 1  # Expected count: 1, or the number of points if points are dropped
    kept: bool = False  # True if the tracker uses the scan without the dropped points


def _good(stamp_ns: int) -> PointCloud2:
    return detections.to_msg(scans.report(0, 0), stamp_ns, "radar_1")


def _change(change: Change) -> Callable[[int], bytes]:
    def make(stamp_ns: int) -> bytes:
        cloud = _good(stamp_ns)
        change(cloud)
        return bytes(interfaces.encode(cloud))

    return make


def _set(**values: Any) -> Callable[[int], bytes]:
    """Return a function that sets members of a cloud; ``__`` stands for the dot in a path."""

    def change(cloud: PointCloud2) -> None:
        for path, value in values.items():
            *parents, name = path.split("__")
            setattr(reduce(getattr, parents, cloud), name, value)

    return _change(change)


def _field(which: str, **values: Any) -> Callable[[int], bytes]:
    def change(cloud: PointCloud2) -> None:
        for field in cloud.fields:
            if field.name == which:
                for key, value in values.items():
                    setattr(field, key, value)

    return _change(change)


def _without(name: str) -> Callable[[int], bytes]:
    def change(cloud: PointCloud2) -> None:
        cloud.fields = [field for field in cloud.fields if field.name != name]

    return _change(change)


def _data(change: Callable[[bytes], bytes]) -> Callable[[int], bytes]:
    return _change(lambda cloud: setattr(cloud, "data", change(bytes(cloud.data))))


def _stamp(seconds: int, nanoseconds: int) -> Callable[[int], bytes]:
    return _set(header__stamp__sec=seconds, header__stamp__nanosec=nanoseconds)


def _points(*point: float, count: int = POINTS) -> Callable[[int], bytes]:
    """Return a function that makes a cloud of points of this range, azimuth and amplitude."""
    distance, azimuth, amplitude = point

    def make(stamp_ns: int) -> bytes:
        measurement = np.tile([distance, azimuth], (count, 1))
        found = Detections(measurement, np.full(count, amplitude))
        with np.errstate(invalid="ignore"):  # Some values are not finite.
            cloud = detections.to_msg(found, stamp_ns, "radar_1")
        return bytes(interfaces.encode(cloud))

    return make


def _points_case(name: str, reason: str, *point: float) -> BadScan:
    return BadScan(f"points: {name}", reason, _points(*point), POINTS, kept=True)


def cases() -> list[BadScan]:
    """Return all cases."""
    schema = {
        "no fields": _set(fields=[]),
        "no range": _without("range"),
        "no azimuth": _without("azimuth"),
        "range in capitals": _field("range", name="RANGE"),
        "range a whole number": _field("range", datatype=PointField.INT32),
        "azimuth a byte": _field("azimuth", datatype=PointField.UINT8),
        "datatype 0": _field("azimuth", datatype=0),
        "datatype 255": _field("range", datatype=255),
        "two ranges a point": _field("range", count=2),
        "no range a point": _field("range", count=0),
        "most azimuths a point": _field("azimuth", count=LARGEST),
        "three amplitudes a point": _field("amplitude", count=3),
        "field beyond the step": _field("range", offset=26),
        "field at the largest offset": _field("range", offset=LARGEST),
        "point_step 0": _set(point_step=0),
        "point_step too small": _set(point_step=13),
        "largest point_step": _set(point_step=LARGEST),
        "row_step 0": _set(row_step=0),
        "largest row_step": _set(row_step=LARGEST),
        "two rows said": _set(height=2),
        "no rows said": _set(height=0),
        "a point more said": _change(lambda cloud: setattr(cloud, "width", cloud.width + 1)),
        "no data": _set(data=b""),
        "a byte short": _data(lambda data: data[:-1]),
        "a byte long": _data(lambda data: data + b"\0"),
        "a single byte": _set(data=b"\0"),
    }
    oversize = {
        "a million points said": _set(width=10**6),
        "a million rows said": _set(height=10**6),
        "the most points that can be said": _set(width=LARGEST, height=LARGEST),
        "100 001 points": _points(500.0, 500.0, 5.0, count=100_001),
    }
    frame = {
        "unknown frame": _set(header__frame_id="base_link"),
        "the other radar's frame": _set(header__frame_id="radar_2"),
        "frame with a slash": _set(header__frame_id="/radar_1"),
        "frame of 10 000 letters": _set(header__frame_id="r" * 10_000),
    }
    stamp = {
        "seconds below zero": _stamp(-5, 0),
        "the lowest seconds": _stamp(-(2**31), 0),
        "nanoseconds above a second": _stamp(1, LARGEST),
    }
    groups = {"schema": schema, "oversize": oversize, "frame": frame, "any": stamp}
    nan, inf = float("nan"), float("inf")
    return [
        *(
            BadScan(f"{reason}: {name}" if reason != "any" else f"stamp: {name}", reason, data)
            for reason, group in groups.items()
            for name, data in group.items()
        ),
        _points_case("NaN range", "not_finite", nan, 0.0, 5.0),
        _points_case("NaN azimuth", "not_finite", 900.0, nan, 5.0),
        _points_case("infinite azimuth", "not_finite", 900.0, inf, 5.0),
        _points_case("infinite range", "not_finite", inf, 0.0, 5.0),
        _points_case("infinite amplitude", "amplitude", 900.0, 0.0, inf),
        _points_case("negative range", "range", -5.0, 0.0, 5.0),
        _points_case("beyond the range", "range", 1e6, 0.0, 5.0),
        _points_case("an azimuth that is no angle", "azimuth", 900.0, 1e30, 5.0),
        _points_case("negative amplitude", "amplitude", 900.0, 0.0, -1.0),
        _points_case("absurd amplitude", "amplitude", 900.0, 0.0, 1e30),
    ]


@measures("exits or NaN on bad scans", "0, every reject counted")
def measure(chosen: list[BadScan] | None = None) -> Found:
    """Send every case between valid scans; count exits, lost valid scans and rejects."""
    chosen = cases() if chosen is None else chosen
    with Rig() as rig:
        tracker, radars = rig.tracking(*LIGHT)
        exits, lost = [], []
        wanted: Counter[str] = Counter()
        found: Counter[str] = Counter()
        index = 0
        for case in chosen:
            index += 1
            answered = _send(radars, case, index)
            if not tracker.alive:
                exits.append(case.name)
                found += _summary_counts(tracker.text)
                tracker, _ = rig.tracking(*LIGHT)  # Its counts start from zero
                continue
            wanted[case.reason] += case.count
            lost += [] if answered else [case.name]
        found += _counts(radars)
        not_finite = radars.not_finite
    # The reason ``any`` is met by a count under any other reason.
    uncounted = wanted - found - Counter({"any": wanted["any"]})
    surplus = (found - wanted).total() - wanted["any"]
    whole = not exits and not uncounted and surplus >= 0
    text = (
        f"{len(exits)} exits, {not_finite} with NaN, {len(lost)} good scans lost, "
        f"{len(chosen)} cases; {'every reject counted' if whole else 'rejects not all counted'}"
    )
    details = {"cases": len(chosen), "exits": exits, "good_scans_lost": lost}
    details |= {"not_finite": not_finite, "wanted": dict(wanted), "counted": dict(found)}
    return text, whole and not not_finite and not lost, details


def _send(radars: Radars, case: BadScan, index: int) -> bool:
    """Send a case and then the valid scan of the same stamp; return whether that was answered."""
    stamp_ns = scans.stamp_of_scan(index)
    radars.outputs[0].publish(case.data(stamp_ns))
    if case.kept:  # The faulty cloud is then the first radar's report of this scan
        radars.outputs[1].publish(scans.cloud(index, 1))
        return radars.wait_for({stamp_ns})
    return radars.track(index, timeout_s=REPLY_S)


def _summary_counts(text: str) -> Counter[str]:
    """Return the first radar's drops by reason, from the summary that a tracker logs at its end."""
    words = re.findall(r"radar_1 (\w+) (\d+)", text.rpartition("stopped;")[2])
    return Counter({reason: int(count) for reason, count in words})


def _counts(radars: Radars) -> Counter[str]:
    """Return the first radar's drops by reason, from its diagnostics."""
    return Counter(
        {
            key.removeprefix("dropped_"): int(value)
            for key, value in radars.values("radar_1").items()
            if key.startswith("dropped_")
        }
    )
