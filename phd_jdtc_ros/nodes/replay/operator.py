"""Repeats the manual work of a recording: calls the tracker's services, one after the other."""

from __future__ import annotations

import time
from collections import Counter, deque

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.task import Future

from msg_adapters.encoding import interfaces, names
from msg_adapters.encoding.errors import RejectedMessageError
from msg_adapters.outgoing import manual
from phd_jdtc_ros.core.tracks.manual import VERBS

from .playback import GIVE_UP_S


class Operator:
    """Does the work that is given to it at a tracker, in order."""

    def __init__(self, node: Node, tracker: str) -> None:
        self._node = node
        self._clients = {
            verb: node.create_client(SetParametersAtomically, f"{tracker}/{verb}_track")
            for verb in VERBS
        }
        self._due: deque[bytes] = deque()
        self._called: tuple[str, Future, float] | None = None
        self.counts: Counter[str] = Counter()  # What became of the work: done, refused

    def add(self, data: bytes) -> None:
        """Add a serialised message of manual work."""
        self._due.append(data)

    def forget(self) -> None:
        """Forget what is due, because the recording goes on elsewhere."""
        self._due.clear()

    @property
    def has_work(self) -> bool:
        """Whether some work is to be done, or its answer is not there."""
        return self._called is not None or bool(self._due)

    def waits(self) -> bool:
        """Take an answer, do what is next, and return `has_work`."""
        if self._called is not None:
            words, answer, since_s = self._called
            if not answer.done():
                if time.monotonic() - since_s < GIVE_UP_S:
                    return True
                self._note("refused", f"{words}: no answer")
            elif answer.result().result.successful:
                self._note("done")
            else:
                self._note("refused", f"{words}: {answer.result().result.reason}")
            self._called = None
        if self._due:
            self._call(self._due.popleft())
        return self.has_work

    def _call(self, data: bytes) -> None:
        try:
            _, command = manual.from_msg(interfaces.decode(data, names.FIGURES))
        except RejectedMessageError as error:
            self._note("refused", str(error))
            return
        client = self._clients[command.verb]
        words = f"{client.srv_name} {command.track or ''}".rstrip()
        if not client.service_is_ready():
            self._note("refused", f"{words}: no such service")
            return
        request = SetParametersAtomically.Request(parameters=manual.to_request(command))
        self._called = words, client.call_async(request), time.monotonic()

    def _note(self, what: str, warning: str = "") -> None:
        self.counts[what] += 1
        if warning:
            self._node.get_logger().warning(f"recorded manual work: {warning}")
