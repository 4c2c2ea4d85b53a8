"""Whether radars agree with each other, as diagnostics: a status for each of several radars."""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters import diagnostics, names
from phd_jdtc_ros.calibration.registration.monitor import LEAST, MeanResidual

ADVICE = "record a bag and run register"


def status(found: MeanResidual, node: str) -> DiagnosticStatus:
    """Return the status of a radar; `node` is the full name of the tracker."""
    values: dict[str, object] = {"residuals": found.residuals}
    if found.residuals:
        values |= {
            "range_residual_m": float(found.mean[0]),
            "range_sigma_m": float(found.sigma[0]),
            "azimuth_residual_deg": math.degrees(found.mean[1]),
            "azimuth_sigma_deg": math.degrees(found.sigma[1]),
        }
    level, text = _judged(found)
    line = f"registration of {found.radar}"
    return diagnostics.status(
        names.health(line, node), values, level, text, names.hardware(found.radar, node)
    )


def _judged(found: MeanResidual) -> tuple[bytes, str]:
    """Return the level and the message."""
    if found.residuals < LEAST:
        return DiagnosticStatus.OK, (
            f"{found.residuals} detections of tracks that other radars see too, judged from {LEAST}"
        )
    seen = []
    if found.significant[0]:
        seen.append(f"ranges {found.mean[0]:+.3g} m (sigma {found.sigma[0]:.2g})")
    if found.significant[1]:
        mean, sigma = (math.degrees(value[1]) for value in (found.mean, found.sigma))
        seen.append(f"azimuths {mean:+.3g} degrees to the left (sigma {sigma:.2g})")
    if seen:
        return DiagnosticStatus.WARN, (
            f"off the tracks that other radars see too: {', '.join(seen)}; {ADVICE}"
        )
    return DiagnosticStatus.OK, "agrees with the other radars"
