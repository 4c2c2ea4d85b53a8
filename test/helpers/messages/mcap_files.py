"""Small MCAP files with topics of any type."""

from mcap.writer import Writer


def write(path, types, messages):
    """Write `messages`, (topic, log time, CDR bytes) in order, of topics with `types`."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="test")
        channels = {}
        for topic, type_name in types.items():
            schema = writer.register_schema(type_name, "ros2msg", b"")
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for sequence, (topic, log_time_ns, data) in enumerate(messages):
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence)
        writer.finish()
    return path
