import os
import random
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from marker_messages import marker_array, pose_array
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from samples import FRAME, STAMP_NS, plain
from samples import detections as some_detections
from samples import estimates as some_estimates
from samples import truth as some_truth
from std_msgs.msg import Float64

from msg_adapters.encoding import RejectedMessageError, interfaces, names
from msg_adapters.incoming import detections
from msg_adapters.outgoing import diagnostics, outputs
from msg_adapters.targets import estimates, truth

TYPES = [names.CLOUD, names.POSES, names.MARKERS, names.FIGURES, names.NUMBER]
STORE = get_typestore(Stores.ROS2_JAZZY)


def figures():
    # Names of odd lengths leave gaps that are padded.
    warning = diagnostics.status("odd", {"a": 0.1, "bcd": 3}, DiagnosticStatus.WARN, "why")
    return diagnostics.array(STAMP_NS, [warning, diagnostics.status("", {})])


MESSAGES = {
    "detections": lambda: detections.to_msg(some_detections(), STAMP_NS, FRAME),
    "truth": lambda: truth.to_msg(some_truth(), "map"),
    "estimates": lambda: estimates.to_msg(some_estimates(), "map"),
    "no_estimates": lambda: estimates.to_msg(some_estimates(0), "map"),
    "poses": lambda: pose_array(some_estimates(), 0, "map"),
    "markers": lambda: marker_array(some_estimates(), "map", ("a", "bc")),
    "figures": figures,
    "number": lambda: Float64(data=0.1),
}


@pytest.fixture(params=MESSAGES)
def message(request):
    return MESSAGES[request.param]()


def test_the_messages_here_are_of_every_type_that_is_spoken():
    spoken = {interfaces.type_name(type(make())) for make in MESSAGES.values()}
    assert spoken == set(TYPES) == set(outputs.default_topics(2).values())


@pytest.mark.parametrize("name", TYPES)
def test_types_definitions_and_hashes_are_those_of_an_independent_library(name):
    assert interfaces.type_name(interfaces.message_class(name)) == name
    assert interfaces.type_hash(name) == STORE.hash_rihs01(name)
    found = get_types_from_msg(interfaces.definition(name), name)
    assert (len(found) > 1) == (name != names.NUMBER)
    assert found == {held: STORE.fielddefs[held] for held in found}


@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize("data", [b"", b"\0", b"\0\1\0\0", b"\xff" * 64, b"text, no message"])
def test_decode_rejects_garbage(name, data):
    with pytest.raises(RejectedMessageError, match=f"not a {name}") as caught:
        interfaces.decode(data, name)
    assert caught.value.reason == "schema"


@pytest.mark.parametrize("name", ["no_such_msgs/msg/Type", "sensor_msgs/msg/NoSuchType", "garbage"])
def test_decode_rejects_an_unknown_type(name):
    with pytest.raises(RejectedMessageError, match=f"not a {name}"):
        interfaces.decode(b"\0\1\0\0", name)


def test_decode_of_mutated_bytes_is_a_message_or_a_rejection(message):
    rng = random.Random(7)
    name = interfaces.type_name(type(message))
    original = serialize_message(message)
    rejected = 0
    for _ in range(300):
        data = bytearray(original[: rng.randint(0, len(original))])
        for _ in range(rng.randint(0, 4)):
            if data:
                data[rng.randrange(len(data))] = rng.randrange(256)
        try:
            found = interfaces.decode(bytes(data), name)
        except RejectedMessageError:
            rejected += 1
        else:
            assert type(found) is type(message)
    assert rejected > 0


def test_definition_suffices_for_an_independent_reader(message):
    name = interfaces.type_name(type(message))
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(interfaces.definition(name), name))
    sent = deserialize_message(serialize_message(message), type(message))
    assert plain(store.deserialize_cdr(bytes(serialize_message(message)), name)) == plain(sent)


def test_messages_pass_the_field_checks_of_ros():
    script = """
        import os
        assert os.environ["ROS_PYTHON_CHECK_FIELDS"] == "1"
        import pytest
        from geometry_msgs.msg import Point
        from rclpy.serialization import serialize_message
        with pytest.raises(AssertionError):
            Point(x=1)
        from test_interfaces import MESSAGES
        for name, make in MESSAGES.items():
            serialize_message(make())
            print(name)
    """
    here = str(Path(__file__).parent)
    path = os.pathsep.join([here, *sys.path])
    environment = {**os.environ, "ROS_PYTHON_CHECK_FIELDS": "1", "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == ""
    assert done.stdout.split() == list(MESSAGES)
    assert done.returncode == 0
