"""Compiles the engines and `tune` ahead of their first start, for images and new installations."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence

from phd_jdtc_ros.configuration.build import resolve
from phd_jdtc_ros.configuration.engines import new_engine
from phd_jdtc_ros.core import compilation
from phd_jdtc_ros.core.state_space import SPATIAL
from phd_jdtc_ros.exit_status import FAILED, OK, ArgumentParser
from phd_jdtc_ros.parameter_files import from_arguments

from . import command

CORE = "phd_jdtc_ros.core"
# The compiled functions of sensors that engines load with the first of these.
POSITIONS, RADARS_IN_SPACE = (
    f"{CORE}.sensors.of_gaussians.{name}" for name in ("planar", "spatial")
)
# The compiled functions of `tune`.
TUNING = "phd_jdtc_ros.calibration.tuning.linking"
# Nearly all compiled functions, in parts that take about equally long and have few in common.
PARTS = (
    (f"{CORE}.gaussian.measurement.pair_association",),
    (f"{CORE}.gaussian.smoothing.backward_step", POSITIONS),
    (f"{CORE}.gaussian.new_targets", f"{CORE}.gaussian.reduction"),
    (TUNING, f"{CORE}.sensors.of_gaussians.polar", f"{CORE}.tracks.confirmation"),
    # Only trackers with a receiver of self-reports load these.
    (f"{CORE}.reports.beside", RADARS_IN_SPACE),
)
# Compiles what a process has imported for states in space, too.
IN_SPACE = f"{CORE}.compilation.compile_for({len(SPATIAL)})"


@contextlib.contextmanager
def _compiling(parts: Sequence[Sequence[str]]) -> Iterator[None]:
    """Compile each part in a process of its own, since numba compiles in one thread only."""
    # A process may fail in silence: what it could not compile or store is tried again here.
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", f"import {', '.join(part)}; {IN_SPACE}"],
            stderr=subprocess.DEVNULL,
        )
        for part in parts
    ]
    try:
        yield
        for process in processes:
            process.wait()
    finally:
        for process in processes:
            process.kill()


def main(argv: Sequence[str]) -> int:
    """Run the tool."""
    parser = ArgumentParser(
        prog="compile_engines",
        description="Compiles the engines and tune, so that their first start does not. The "
        "result is stored in the package's directory, or in NUMBA_CACHE_DIR.",
    )
    return command.run(parser, argv, _compile)


def _compile(_: argparse.Namespace) -> int:
    """Compile the functions of the engines and of `tune`, and store them beside the source."""
    if compilation.numba is None:
        print("compile_engines: numba is not installed: pip install numba", file=sys.stderr)
        return FAILED
    begin = time.perf_counter()
    count = min(len(os.sched_getaffinity(0)), len(PARTS))
    own, *others = [sum(PARTS[first::count], ()) for first in range(count)]
    with _compiling(others):
        for name in own:
            importlib.import_module(name)
        compilation.compile_for(len(SPATIAL))
    for name, profile in (("gaussian", "defaults"), ("phd", "phd")):
        new_engine(resolve(from_arguments.profile(profile)))
        print(f"{name}: ready after {time.perf_counter() - begin:.1f} s")
    compilation.compile_for(len(SPATIAL))
    for name in (POSITIONS, RADARS_IN_SPACE, TUNING):
        importlib.import_module(name)
    print(f"tune: ready after {time.perf_counter() - begin:.1f} s")
    if compilation.NOT_STORED:
        print(
            "compile_engines: the package's directory is not writable, nothing is stored; set "
            "NUMBA_CACHE_DIR to a directory that is, for this command and for the tracker",
            file=sys.stderr,
        )
        return FAILED
    return OK
