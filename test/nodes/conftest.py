import os
import signal
import subprocess
import sys
import time
from contextlib import closing, contextmanager

import pytest
from forked import Forked
from live_radars import connected, start_tracker
from rcl_interfaces.srv import GetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from robustness.harness.radars import Peer as PeerOfRadars

DEADLINE_S = 60.0


class Executable(subprocess.Popen):
    """An executable of the package, started as users start it."""

    def __init__(self, name, arguments, log, environment):
        self.log = log
        with log.open("wb") as stream:
            super().__init__(
                [sys.executable, "-m", "phd_jdtc_ros", name, *arguments],
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
            )


class Processes:
    """Starts executables of the package and ends those that still run."""

    def __init__(self, kind, directory):
        self._kind = kind
        self._directory = directory
        self._started = []

    def start(self, name, *arguments, **environment):
        log = self._directory / f"{getattr(name, '__name__', name)}_{len(self._started)}.log"
        process = self._kind(name, [*map(str, arguments)], log, {**os.environ, **environment})
        self._started.append(process)
        return process

    def run(self, name, *arguments, timeout=DEADLINE_S, **environment):
        process = self.start(name, *arguments, **environment)
        return process.wait(timeout), process.log.read_text()

    def stop_all(self):
        for process in self._started:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in self._started:
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()


class Peer(PeerOfRadars):
    """A node of the test's own, beside those under test."""

    def __init__(self):
        super().__init__("peer")

    def spin_until(self, condition, timeout_s=DEADLINE_S):
        return super().spin_until(condition, timeout_s)

    def said(self, process, text, times=1):
        """Wait until a process has logged a text; return its log."""

        def logged():
            return process.log.read_text().count(text) >= times or process.poll() is not None

        self.spin_until(logged)
        log = process.log.read_text()
        assert log.count(text) >= times, log
        return log

    def pace(self, seconds):
        """Let time pass between two messages, as a radar does; never to wait for something."""
        self.spin(seconds)

    def meet(self, node="/tracker", times=1):
        """Wait until a node has discovered all that this one has, and has taken what was sent.

        What a node announces arrives in order, and the client of its service is announced last. In
        each of the `times` that the node answers, its executor takes one message of each topic.
        """
        client = self.node.create_client(GetParameters, f"{node}/get_parameters")
        for _ in range(times):
            assert self._reply(client, GetParameters.Request()), f"{node} does not answer"
        self.node.destroy_client(client)

    def _reply(self, client, request, timeout=DEADLINE_S):
        """Return the reply to a request that changes nothing, asked again after a second."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            assert self.spin_until(client.service_is_ready, timeout)
            future = client.call_async(request)
            # It may have gone to one that has been killed and is in the graph still, or be lost.
            if self.spin_until(future.done, 1.0):
                return future.result()
            client.remove_pending_request(future)
        return None

    def settled(self, *outputs):
        """Wait until publishers are connected with every subscriber that the graph has."""
        assert self.spin_until(
            lambda: all(
                output.get_subscription_count() == self.node.count_subscribers(output.topic_name)
                for output in outputs
            )
        )

    def ticks(self, count):
        """Wait until a replay's clock of 100 Hz by the wall clock has ticked."""
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        heard = []
        subscription = self.node.create_subscription(Clock, "/clock", heard.append, qos)
        assert self.spin_until(lambda: len(heard) >= count)
        self.node.destroy_subscription(subscription)

    def collect(self, message_type, topic, qos=10):
        found = []
        self.node.create_subscription(message_type, topic, found.append, qos)
        return found

    def publisher(self, message_type, topic, qos=10):
        return self.node.create_publisher(message_type, topic, qos)

    def call(self, service_type, name, request=None):
        client = self.node.create_client(service_type, name)
        assert self.spin_until(client.service_is_ready), f"{name} is not there"
        request = request or service_type.Request()
        if service_type.__name__.startswith(("Get", "List", "Describe")):
            reply = self._reply(client, request)
            assert reply is not None, f"{name} does not answer"
            return reply
        # A reply to a client that the node has not discovered is lost, and is not asked for again.
        self.meet(name.rpartition("/")[0])
        future = client.call_async(request)
        assert self.spin_until(future.done), f"{name} does not answer"
        return future.result()


@contextmanager
def group_of(kind, directory):
    group = Processes(kind, directory)
    try:
        yield group
    finally:
        group.stop_all()


@pytest.fixture
def processes(tmp_path):
    """Nodes that start at once (see `forked`)."""
    with group_of(Forked, tmp_path) as group:
        yield group


@pytest.fixture
def executables(tmp_path):
    """Nodes and tools as users start them."""
    with group_of(Executable, tmp_path) as group:
        yield group


@pytest.fixture
def peer():
    with closing(Peer()) as node:
        yield node


@pytest.fixture(scope="module")
def lasting(tmp_path_factory):
    """Processes and a peer for all tests of a module."""
    directory = tmp_path_factory.mktemp("lasting")
    with group_of(Forked, directory) as group, closing(Peer()) as node:
        yield group, node


@pytest.fixture
def radars(processes, peer):
    """Start a tracker; return the radars that it receives."""
    start_tracker(processes)
    return connected(peer)
