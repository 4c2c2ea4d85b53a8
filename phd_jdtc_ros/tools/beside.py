"""Other studies that run beside a Monte Carlo study, so that no processor waits for them.

They run one after the other, in a process of their own. What they print is kept until the Monte
Carlo study has ended.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from phd_jdtc_ros.exit_status import FAILED, OK
from phd_jdtc_ros.study.monte_carlo.execution import THREAD_VARIABLES

from . import registration

NAMES = ("madap", "registration", "seam", "hours")
# Those whose goals are among the study's; the file that each writes has its name.
WITH_GOALS = ("registration", "hours")


class Beside:
    """A thread that runs other studies; they are stopped with the context if that fails.

    Parameters
    ----------
    studies : sequence of sequences of str
        One of `NAMES` each, with its arguments, in the order in which they run.
    out : Path
        Directory of their results.
    """

    def __init__(self, studies: Sequence[Sequence[str]], out: Path) -> None:
        self._studies = tuple(studies)
        self._out = out
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False
        # Name, whether it succeeded, and what it printed.
        self._ended: list[tuple[str, bool, str]] = []
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Beside:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            with self._lock:
                self._stopped = True
                if self._process is not None:
                    self._process.terminate()
        self._thread.join()

    def busy(self) -> int:
        """Return how many processes they take now."""
        return int(self._thread.is_alive())

    def finish(self) -> int:
        """Wait for them, print what they have printed, and return failure if one has failed.

        The goals of those that have some are written among those of the study's summary, which is
        written after them.
        """
        self._thread.join()
        for name, succeeded, text in self._ended:
            sys.stdout.write(text)
            if name in WITH_GOALS and succeeded:
                found = (self._out / f"{name}.json").read_text(encoding="utf-8")
                registration.merge(self._out / registration.SUMMARY, json.loads(found)["goals"])
        whole = len(self._ended) == len(self._studies)
        return OK if whole and all(succeeded for _, succeeded, _ in self._ended) else FAILED

    def _run(self) -> None:
        settings = dict.fromkeys(THREAD_VARIABLES, "1")
        settings["COLUMNS"] = str(shutil.get_terminal_size().columns)
        for study in self._studies:
            with self._lock:
                if self._stopped:
                    return
                try:
                    self._process = subprocess.Popen(
                        [sys.executable, "-m", "phd_jdtc_ros", *study, "--out", str(self._out)],
                        env={**os.environ, **settings},
                        stdout=subprocess.PIPE,
                        text=True,
                    )
                except OSError as error:
                    self._ended.append((study[0], False, f"{study[0]}: not started: {error}\n"))
                    continue
            text, _ = self._process.communicate()
            self._ended.append((study[0], self._process.returncode == OK, text))
