from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus

from msg_adapters.outgoing import diagnostics
from phd_jdtc_ros.nodes.common.health import LASTING_S, StatusLog

OK, WARN = DiagnosticStatus.OK, DiagnosticStatus.WARN
ERROR, STALE = DiagnosticStatus.ERROR, DiagnosticStatus.STALE


def said(*looks):
    """Return what is logged of looks: seconds, level and message of the status `north`."""
    found, now = [], [0.0]
    levels = ("info", "warning", "error")
    logger = {level: lambda text, level=level: found.append((level, text)) for level in levels}
    log = StatusLog(SimpleNamespace(**logger), lambda: now[0])
    for now[0], level, text in looks:
        log.take([diagnostics.status("north", {}, level, text)])
    return found


def test_every_lasting_cause_is_logged_once_and_what_goes_by_is_not():
    silent = [(t, STALE, f"silent for {t:.1f} s") for t in range(20)]
    well = [(t, OK, "receiving") for t in range(20, 40)]
    assert said((-9, OK, "receiving"), *silent, *well) == [
        ("warning", f"north: silent for {LASTING_S:.1f} s"),
        ("info", "north: receiving again"),
    ]
    quiet = [(t, STALE, "silent") for t in range(9)]
    shared = [(t, ERROR, "several publishers") for t in range(9, 20)]
    assert [level for level, _ in said(*quiet, *shared)] == ["warning", "error"]
    assert not said(*((t, (OK, WARN)[t % 2], "xy"[t % 2]) for t in range(50)))
