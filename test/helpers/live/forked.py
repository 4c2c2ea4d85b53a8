"""Nodes as forks of a process that has imported them: importing takes most of a node's start."""

import multiprocessing
import os
import signal
import subprocess
import sys

from phd_jdtc_ros.__main__ import EXECUTABLES, NODES, run

OFTEN = (*(EXECUTABLES[name][0] for name in ("tracker", "sensor_replay", "evaluator")),)
# Slow imports that nodes make on demand: the compiled engine, and the support of message types.
ON_DEMAND = ("phd_jdtc_ros.core.window.fixed_lag", "rosidl_generator_py")

_context = multiprocessing.get_context("forkserver")
_nodes = [f"phd_jdtc_ros.{path}" for path in (*OFTEN, *NODES.values())]
_preloaded = [*_nodes, *ON_DEMAND]
_context.set_forkserver_preload(_preloaded)


def preload(module):
    """Have a module imported in all nodes of this pytest, which none has started yet."""
    _context.set_forkserver_preload([*_preloaded, module])


class Forked:
    """A process that runs one of the executables; as much of a `subprocess.Popen` as tests use.

    Parameters
    ----------
    name : str or callable
        The executable, or a function of its arguments that can be imported.
    arguments : sequence of str
    log : Path
        Of the file that gets what it prints.
    environment : mapping
    """

    def __init__(self, name, arguments, log, environment):
        self.log = log
        log.touch()
        self._process = _context.Process(
            target=_run, args=(name, arguments, log, environment), daemon=True
        )
        self._process.start()
        self.pid = self._process.pid

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self._process.exitcode

    def wait(self, timeout=None):
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout)
        return self._process.exitcode

    def send_signal(self, number):
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self):
        self.send_signal(signal.SIGTERM)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def _run(name, arguments, log, environment):
    with log.open("wb") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    os.environ.clear()
    os.environ.update(environment)
    # As the start of an interpreter would.
    sys.path[:0] = filter(None, environment.get("PYTHONPATH", "").split(os.pathsep))
    sys.exit(name(arguments) if callable(name) else run(name, arguments))
