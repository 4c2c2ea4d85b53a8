"""Manual work on tracks to and from messages: as named values of a service, and as recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter, parameter_value_to_python

from phd_jdtc_ros.configuration import schema
from phd_jdtc_ros.core.sensors.site import Plane
from phd_jdtc_ros.core.tracks.manual import DROP, MARK, NAME, RESTORE, START, VERBS, Command

from ..encoding import RejectedMessageError, stamps
from . import diagnostics

# The values of each verb, by name, and those of a start that may be left out.
VALUES: dict[str, Sequence[str]] = {
    START: ("x", "y", "vx", "vy", "latitude", "longitude"),
    DROP: ("track",),
    RESTORE: ("track",),
    NAME: ("track", "name"),
    MARK: ("track", "mark"),
}
MOTION = ("x", "y", "vx", "vy")
FARTHEST, FASTEST = 1e7, 1e4  # Metres, metres per second


def of_request(verb: str, parameters: Sequence[Any], plane: Plane | None) -> Command:
    """Return the command of a service's named values, ``rcl_interfaces/Parameter``.

    A start has x and y, or latitude and longitude with `plane`. Raise `ValueError` with the fault.
    """
    given = {each.name: parameter_value_to_python(each.value) for each in parameters}
    allowed = VALUES[verb]
    unknown = sorted(given.keys() - {*allowed})
    if unknown:
        raise ValueError(f"{unknown[0]}: given, must be one of {', '.join(allowed)}")
    if verb == START and "latitude" in given:
        if plane is None:
            raise ValueError("latitude: given, needs world_origin")
        place = (_number(given, name, 360.0) for name in ("latitude", "longitude"))
        x, y = plane.to_plane(*place)
        given |= {"x": float(x), "y": float(y)}
    return _command(verb, given)


def to_request(command: Command) -> list[Any]:
    """Return a command as the named values of its service, see `of_request`."""
    return [Parameter(n, value=v).to_parameter_msg() for n, v in _values_of(command).items()]


def _values_of(command: Command) -> dict[str, Any]:
    if command.verb == START:
        return dict(zip(MOTION, command.motion, strict=True))
    texts = {VALUES[command.verb][-1]: command.text} if command.verb in (NAME, MARK) else {}
    return {"track": command.track, **texts}


def _command(verb: str, given: Mapping[str, Any]) -> Command:
    if verb == START:
        zero = {"vx": 0.0, "vy": 0.0}
        x, y = (_number(given, name, FARTHEST) for name in ("x", "y"))
        vx, vy = (_number({**zero, **given}, name, FASTEST) for name in ("vx", "vy"))
        return Command(verb, motion=(x, y, vx, vy))
    track = given.get("track")
    if isinstance(track, bool) or not isinstance(track, int):
        raise ValueError(f"track: {track!r} given, must be a whole number")
    text = given.get(VALUES[verb][-1], "") if verb in (NAME, MARK) else ""
    if not isinstance(text, str):
        raise ValueError(f"{VALUES[verb][-1]}: {text!r} given, must be a string")
    return Command(verb, track, text)


def _number(given: Mapping[str, Any], name: str, most: float) -> float:
    found = schema.number(given.get(name), -most, most)
    if found is None:
        raise ValueError(f"{name}: {given.get(name)!r} given, must be a number within {most:g}")
    return found


def to_msg(stamp_ns: int, command: Command) -> DiagnosticArray:
    """Encode a command that was done after the scan of a stamp, 0 before the first one."""
    return diagnostics.array(stamp_ns, [diagnostics.status(command.verb, _values_of(command))])


def from_msg(message: DiagnosticArray) -> tuple[int, Command]:
    """Return the stamp and the command of a message; raise `RejectedMessageError`."""
    verb = message.status[0].name if len(message.status) == 1 else ""
    if verb not in VERBS:
        raise RejectedMessageError("schema", f"manual work {verb[:40]!r} is unknown")
    texts = diagnostics.values_of(message.status[0])
    try:
        values: dict[str, Any] = {
            name: int(text) if name == "track" else float(text) if name in MOTION else text
            for name, text in texts.items()
        }
        command = _command(verb, values)
    except ValueError as error:
        raise RejectedMessageError("schema", f"manual work: {error}") from error
    return stamps.of_header(message.header), command
