"""Storage of the learned values of sensors in a snapshot, and their restoration."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..learned.change_alarm import ChangeAlarm
from ..learned.correlation import SUMS, Correlation
from ..learned.detection_chains import DetectionChains
from ..learned.detection_factor import AZIMUTHS, CELLS, DetectionFactor
from ..learned.noise_factor import NoiseFactor
from ..learned.open_trials import OpenTrials
from ..models.sensor_learning import SensorMemory
from ..sensors.sensor import Sensor
from ..snapshot import Snapshot, from_snapshot, to_snapshot

DETECTION, NOISE, TRIALS = "detection_factor", "noise_factor", "open_looks"
CORRELATION, CHAINS, ALARM = "correlation", "last_looks", "change_alarm"


def sensors_to_snapshot(memory: SensorMemory, snapshot: Snapshot) -> None:
    """Store the learned values of sensors, if there are any."""
    for name, detection in memory.detection.items():
        to_snapshot(detection, snapshot, f"{DETECTION}.{name}")
    for name, noise in memory.noise.items():
        to_snapshot(noise, snapshot, f"{NOISE}.{name}")
    for name, correlation in memory.correlation.items():
        to_snapshot(correlation, snapshot, f"{CORRELATION}.{name}")
    for name, chains in memory.chains.items():
        to_snapshot(chains, snapshot, f"{CHAINS}.{name}")
    for name, alarm in memory.alarms.items():
        to_snapshot(alarm, snapshot, f"{ALARM}.{name}")
    if memory.detection:
        to_snapshot(memory.trials, snapshot, TRIALS)


def sensors_from_snapshot(snapshot: Snapshot, sensors: Sequence[Sensor]) -> SensorMemory:
    """Return the learned values of these sensors.

    A learned value is dropped if the configuration sets it now. The open trials are dropped if the
    learned detection probability of any sensor is not in the snapshot.

    Raises
    ------
    ValueError
        If a value belongs to another sensor, or a tracker could not have stored it.
    """
    known = {sensor.name: sensor for sensor in sensors}
    memory = SensorMemory(tuple(known))
    for name in _sensors(snapshot, DETECTION, known):
        if (start := known[name].detection_factor) is not None:
            part = snapshot, f"{DETECTION}.{name}", {"K": CELLS}
            found = from_snapshot(DetectionFactor, *part, max_range=start.max_range)
            memory.detection[name] = found
    for name in _sensors(snapshot, NOISE, known):
        if (own := known[name].noise_factor) is not None:
            part = snapshot, f"{NOISE}.{name}", {"Z": len(own.learned)}
            memory.noise[name] = from_snapshot(NoiseFactor, *part, learned=own.learned)
    for name in _sensors(snapshot, ALARM, known):
        if known[name].detection_factor is not None or known[name].noise_factor is not None:
            part = snapshot, f"{ALARM}.{name}", {"A": 1 + AZIMUTHS, "Z": 2}
            memory.alarms[name] = from_snapshot(ChangeAlarm, *part)
    for name in _sensors(snapshot, CHAINS, known):
        if (first := known[name].correlation) is None:
            continue
        memory.chains[name] = from_snapshot(
            DetectionChains, snapshot, f"{CHAINS}.{name}", {"B": SUMS}
        )
        if first.learned and snapshot.names_below(f"{CORRELATION}.{name}"):
            sums = from_snapshot(
                Correlation,
                snapshot,
                f"{CORRELATION}.{name}",
                {"B": SUMS},
                start=first.start,
                learned=True,
            )
            memory.correlation[name] = sums
    learning = [name for name in known if known[name].detection_factor is not None]
    if snapshot.names_below(TRIALS) and set(learning) <= memory.detection.keys():
        memory.trials = from_snapshot(OpenTrials, snapshot, TRIALS, {"K": CELLS * len(known)})
    return memory


def _sensors(snapshot: Snapshot, part: str, known: Collection[str]) -> list[str]:
    """Return the sensors named in a part of a snapshot; raises ValueError for unknown ones."""
    names = snapshot.names_below(part)
    for name in names.difference(known):
        raise ValueError(f"{part}: {name[:40]} given, must be a sensor: {', '.join(known)}")
    return sorted(names)
