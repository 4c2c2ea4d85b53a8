"""Whether radars agree with each other, as diagnostics: a status for each of several radars."""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.calibration.registration.monitor import LEAST, Drift

ADVICE = "record a bag and run register"


def status(drift: Drift, node: str) -> DiagnosticStatus:
    """Return the status of a radar; `node` is the full name of the tracker."""
    values: dict[str, object] = {"residuals": drift.residuals}
    if drift.residuals:
        values |= {
            "range_residual_m": float(drift.mean[0]),
            "range_sigma_m": float(drift.sigma[0]),
            "azimuth_residual_deg": math.degrees(drift.mean[1]),
            "azimuth_sigma_deg": math.degrees(drift.sigma[1]),
        }
    level, text = _judged(drift)
    line = f"registration of {drift.radar}"
    return diagnostics.status(
        names.health(line, node), values, level, text, names.hardware(drift.radar, node)
    )


def _judged(drift: Drift) -> tuple[bytes, str]:
    """Return the level and the message."""
    if drift.residuals < LEAST:
        return DiagnosticStatus.OK, (
            f"{drift.residuals} detections of tracks that other radars see too, judged from {LEAST}"
        )
    seen = []
    if drift.drifts[0]:
        seen.append(f"ranges {drift.mean[0]:+.3g} m (sigma {drift.sigma[0]:.2g})")
    if drift.drifts[1]:
        mean, sigma = (math.degrees(value[1]) for value in (drift.mean, drift.sigma))
        seen.append(f"azimuths {mean:+.3g} degrees to the left (sigma {sigma:.2g})")
    if seen:
        return DiagnosticStatus.WARN, (
            f"off the tracks that other radars see too: {', '.join(seen)}; {ADVICE}"
        )
    return DiagnosticStatus.OK, "agrees with the other radars"
