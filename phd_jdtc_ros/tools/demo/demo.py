"""The demo in one command: replay, track and evaluate over DDS, then write the report.

The three nodes run as separate processes in their own ROS domain, on this machine only. The replay
is in lock-step with the tracker, so it runs as fast as the CPU allows and loses no message. The
tracker has the parameters beside the bag, unless others are given. The results of an earlier demo
are replaced only after the nodes have ended without failure.

A recording of ASTERIX beside the bag is sent by UDP, as its radars would send it.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from phd_jdtc_ros import output_files, resources
from phd_jdtc_ros.bags import BagError
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.configuration import scene
from phd_jdtc_ros.configuration.build import TrackerConfig, resolve
from phd_jdtc_ros.configuration.engines import ENGINES
from phd_jdtc_ros.configuration.schema import ConfigError
from phd_jdtc_ros.earth import SystemPlane
from phd_jdtc_ros.evaluation.run_scores import ORDER
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import bag_parameters, from_arguments, yaml_files
from phd_jdtc_ros.report import figures
from phd_jdtc_ros.report.table import metrics

from .. import command, report
from ..track_bag import track_bag
from . import asterix, processes
from .processes import METRICS, PARAMETERS, RECORDING, Processes

# The paper's filter as printed, and with its errors corrected, which the demo compares.
PAPER = ("phd_as_printed", "phd")
LOGS = "logs"
# All files that a demo writes, relative to its output directory.
ARTEFACTS = (
    METRICS,
    report.PAGE,
    *(f"{picture.name}.png" for picture in figures.PICTURES),
    *(f"{LOGS}/{node}.log" for node in ("evaluator", "tracker", "sensor_replay")),
    f"{LOGS}/{PARAMETERS}",
    *(f"{RECORDING}/{name}" for name in (f"{RECORDING}_0.mcap", "metadata.yaml", PARAMETERS)),
)


def run_nodes(bag: Path, config: TrackerConfig, out: Path, logs: Path, cutoff: float) -> bool:
    """Replay a bag through the three nodes; see `processes.run`."""

    def play(nodes: Processes) -> bool:
        return processes.replay(nodes, bag, config)

    return processes.run(bag, config, out, logs, cutoff, play)


def _places(profile: Path, bag: Path) -> list[str]:
    """Return assignments of the radars' places in a bag where those of a profile differ."""
    beside = bag_parameters.read(bag)
    if beside is None:
        return []
    recorded, given = (
        from_arguments.config_of(values).values for values in (beside, from_arguments.load(profile))
    )
    places = scene.other_places(recorded, given)
    if places:
        print(f"demo: {', '.join(places)} as in {bag_parameters.path_of(bag)}", file=sys.stderr)
    return [f"{name}:={yaml_files.scalar(value)}" for name, value in places.items()]


def papers_filters(config: TrackerConfig) -> list[TrackerConfig]:
    """Return the configurations of the paper's filter, as printed and corrected.

    They have the other parameters of this tracker; an engine that does not support these is left
    out, and the tracker's own engine too.
    """
    found = []
    for engine in PAPER:
        try:
            found.append(resolve({**config.values, "engine": engine}, SystemPlane))
        except ConfigError:
            continue
    return [each for each in found if each.engine != config.engine]


def scores(bag: Path, config: TrackerConfig, directory: Path) -> dict[str, Any]:
    """Track a bag offline into a new one; return its scores in the form of `metrics.json`."""
    engine = config.values["engine"]
    tracker = track_bag(BagReader(bag), config, directory, f"tracking with {engine}")
    evaluation = tracker.record().evaluate(command.CUTOFF, ORDER)
    return metrics(evaluation, np.array(tracker.step_ms), engine)


def _compare(bag: Path, config: TrackerConfig, out: Path) -> None:
    """Add the scores of the paper's filter on the same bag to the metrics."""
    path = out / METRICS
    summary, compared = json.loads(path.read_text()), []
    if not summary.get("scans"):
        return
    for other in papers_filters(config):
        with tempfile.TemporaryDirectory() as directory:
            compared.append(scores(bag, other, Path(directory) / "bag"))
    text = json.dumps({**summary, "compared": compared}, indent=2, allow_nan=False)
    output_files.write(path, text + "\n")


def _replace(out: Path, new: Path) -> None:
    """Replace the results of an earlier demo, and no other file, by those in `new`."""
    for name in (*ARTEFACTS, *asterix.ARTEFACTS):
        if not name.startswith(f"{LOGS}/"):
            (out / name).unlink(missing_ok=True)
    if (out / RECORDING).is_dir():
        (out / RECORDING).rmdir()
    for path in new.iterdir():
        path.rename(out / path.name)


def _check_recording(out: Path) -> None:
    """Raise `BagError` if the recording's directory has files that are not of a demo."""
    ours = {out / name for name in ARTEFACTS}
    others = [path for path in (out / RECORDING).glob("*") if path not in ours]
    if others:
        raise BagError(f"{others[0]}: is not of a demo, so {out / RECORDING} is not replaced")


def main(argv: Sequence[str]) -> int:
    """Run the demo."""
    parser = ArgumentParser("demo", description=__doc__)
    parser.add_argument("--bag", help=command.BAG)
    parser.add_argument(
        "--profile", metavar="NAME", help="shipped parameters, config/NAME.yaml, with their bag"
    )
    parser.add_argument(
        "--engine", choices=tuple(ENGINES), help="short for -p engine:=NAME; see docs/engines.md"
    )
    parser.add_argument(
        "--out",
        type=Path,
        help="directory; default: out/demo, or out/demo_PROFILE_BAG_ENGINE with the given names",
    )
    command.add_cutoff_argument(parser)
    command.add_parameter_arguments(parser)
    parser.set_defaults(cutoff=None)
    return command.run(parser, argv, _work)


def _work(arguments: argparse.Namespace) -> int:
    profile, shown = arguments.profile, resources.DEFAULT_BAG
    if profile:
        path, shown = resources.profile(profile)
    given = arguments.bag or shown
    cutoffs = {shown: command.CUTOFF, **resources.BAG_CUTOFFS}
    cutoff = arguments.cutoff or cutoffs.get(given, cutoffs[shown])
    bag = resources.bag(given)
    if not bag.exists():
        raise BagError(f"{bag}: no such bag")
    # The profile's parameters are combined with the radars of another bag.
    if profile and (given != shown or asterix.recording(bag) is None):
        arguments.assignments[:0] = _places(path, bag)
        arguments.params_file.insert(0, path)
    if arguments.engine:
        arguments.assignments.append(f"engine:={arguments.engine}")
    other_bag = None if bag.resolve() == resources.bag(shown).resolve() else bag.resolve().stem
    folder = "_".join(filter(None, ("demo", profile, other_bag, arguments.engine)))
    out: Path = arguments.out or Path("out", folder)
    config = command.tracker_config(arguments, bag)
    _check_recording(out)
    with _unfinished_results(out) as new:
        play = run_nodes if asterix.recording(bag) is None else asterix.run_nodes
        if not play(bag, config, new, out / LOGS, cutoff):
            return FAILED
        if bag.resolve() == resources.bag(resources.DEFAULT_BAG).resolve():
            _compare(bag, config, new)
        _replace(out, new)
    summary = json.loads((out / METRICS).read_text())
    report.write(out / RECORDING, out, config, bag.resolve().name, summary, cutoff)
    return OK


@contextmanager
def _unfinished_results(out: Path) -> Iterator[Path]:
    """Yield a new directory below `out`, which is removed at the end."""
    # It holds the results until the nodes have ended without failure.
    new = out / ".unfinished"
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir(parents=True)
    try:
        yield new
    finally:
        if any(new.iterdir()) and (out / METRICS).exists():
            print(f"demo: the results in {out} are those of an earlier demo", file=sys.stderr)
        shutil.rmtree(new, ignore_errors=True)
