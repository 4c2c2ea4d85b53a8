"""Writes simulated self-reports as receivers send them: sentences of AIS, and SBS-1 of aircraft.

Each sentence of AIS follows a tag block with the time of its receipt.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from typing import Any

from phd_jdtc_ros.simulation.self_reports import CLASS_B_S, Received
from phd_jdtc_ros.transponders.messages import AIS, FOOT, KNOT, Heard

# Names and dimensions are sent with the first two reports, as they count when heard twice, and then
# every six minutes.
STATIC_NS, FIRST = 360 * 10**9, 2
_NO_HEADING, _NO_COURSE = 511, 360.0


def lines(reports: Iterable[Received]) -> Iterator[tuple[int, bytes]]:
    """Yield the lines of reports with their times of receipt, nanoseconds since the epoch.

    Raise `ModuleNotFoundError` if there are reports of AIS and pyais is not installed.
    """
    sent: dict[int, tuple[int, int]] = {}
    for receipt_ns, report in reports:
        heard = report.heard
        if heard.network != AIS:
            yield receipt_ns, _sbs(heard, report.time_ns)
            continue
        count, last_ns = sent.get(heard.address, (0, 0))
        messages = [_position(heard, report.time_ns)]
        if heard.name and (count < FIRST or receipt_ns - last_ns > STATIC_NS):
            messages += _static(heard)
            sent[heard.address] = count + 1, receipt_ns
        for message in messages:
            for line in _sentences(message):
                yield receipt_ns, _tagged(receipt_ns, line)


def _sentences(message: dict[str, Any]) -> list[str]:
    from pyais import encode_dict

    found: list[str] = encode_dict(message, sentence_type="VDM")
    return found


def _tagged(receipt_ns: int, sentence: str) -> bytes:
    tag, total = f"c:{receipt_ns // 10**9}".encode(), 0
    for byte in tag:
        total ^= byte
    return b"\\%s*%02X\\%s\r\n" % (tag, total, sentence.encode())


def _position(heard: Heard, time_ns: int) -> dict[str, Any]:
    return {
        "type": 18 if heard.interval_s == CLASS_B_S else 1,
        "mmsi": heard.address,
        "lat": heard.latitude,
        "lon": heard.longitude,
        "speed": round(heard.speed / KNOT, 1),
        "course": round(heard.course, 1) % _NO_COURSE,
        "heading": _NO_HEADING if math.isnan(heard.heading) else int(heard.heading + 0.5) % 360,
        "accuracy": int(heard.accurate == 1),
        "second": time_ns // 10**9 % 60,
    }


def _static(heard: Heard) -> list[dict[str, Any]]:
    bow, stern, port, starboard = heard.hull or (0, 0, 0, 0)
    hull = {"to_bow": bow, "to_stern": stern, "to_port": port, "to_starboard": starboard}
    ship = {"mmsi": heard.address, "shipname": heard.name, "ship_type": heard.type}
    if heard.interval_s != CLASS_B_S:
        return [{"type": 5, **ship, **hull}]
    return [{"type": 24, "partno": 0, **ship}, {"type": 24, "partno": 1, **ship, **hull}]


def _sbs(heard: Heard, time_ns: int) -> bytes:
    moment = datetime.fromtimestamp(time_ns // 10**9, timezone.utc)
    day, clock = f"{moment:%Y/%m/%d}", f"{moment:%H:%M:%S}.{time_ns // 10**6 % 1000:03d}"
    height = "" if math.isnan(heard.height) else f"{heard.height / FOOT:.0f}"
    moving = (
        f"{heard.speed / KNOT:.1f},{heard.course:.1f},{heard.latitude:.6f},{heard.longitude:.6f}"
    )
    first = f"MSG,3,1,1,{heard.address:06X},1,{day},{clock},{day},{clock},{heard.name}"
    return f"{first},{height},{moving},,,,,,0\r\n".encode()
