"""The messages of bags, bags of given messages, and changed copies of bags."""

import itertools

from msg_adapters.encoding import interfaces, names
from msg_adapters.targets import estimates
from phd_jdtc_ros.bags.reader import BagReader
from phd_jdtc_ros.bags.writer import BagWriter, Topic


def messages(path, topic, kind=names.CLOUD):
    """Return the decoded messages of a topic, clouds by default."""
    return [interfaces.decode(entry.data, kind) for entry in BagReader(path).messages([topic])]


def recorded(path, source="filtered"):
    return [estimates.from_msg(cloud) for cloud in messages(path, names.estimates(source))]


def write(path, topics, entries):
    """Write a bag of entries, (topic, message or its bytes, log time), and return its path.

    `topics` are topics, or the names of topics of clouds.
    """
    with BagWriter(path) as bag:
        for topic in topics:
            bag.add_topic(topic if isinstance(topic, Topic) else Topic(topic, names.CLOUD))
        for topic, message, log_time in entries:
            data = message if isinstance(message, bytes) else interfaces.encode(message)
            bag.write(topic, data, log_time)
    return path


def rewrite(source, out, change=lambda entry: [entry], drop=(), add=()):
    """Write a copy of a bag and return its path.

    `change` returns the entries in the place of one, (topic, data, log time). The copy lacks the
    topics of `drop`, and begins with those of `add`: (topic, type, [(data, log time)]).
    """
    reader = BagReader(source)
    kinds = {topic: kind for topic, kind in reader.types.items() if topic not in drop}
    added = [(topic, *entry) for topic, _, entries in add for entry in entries]
    kept = (
        changed
        for entry in reader.messages([*kinds])
        for changed in change((entry.topic, entry.data, entry.log_time_ns))
    )
    kinds |= {topic: kind for topic, kind, _ in add}
    return write(out, [Topic(*item) for item in kinds.items()], itertools.chain(added, kept))


def first(count, source, out):
    """Write the first stamps of a bag and the parameters beside it, and return its path."""
    stamps_ns = sorted({entry.log_time_ns for entry in BagReader(source).messages()})
    rewrite(source, out, lambda entry: [entry] if entry[2] < stamps_ns[count] else [])
    (out / "parameters.yaml").write_bytes((source / "parameters.yaml").read_bytes())
    return out


def edited(edit, chosen):
    """Return a change for `rewrite`: `edit` edits the clouds of the `chosen` (topic, log time)."""

    def change(entry):
        topic, data, log_time = entry
        if not chosen(topic, log_time):
            return [entry]
        cloud = interfaces.decode(data, names.CLOUD)
        edit(cloud)
        return [(topic, interfaces.encode(cloud), log_time)]

    return change
