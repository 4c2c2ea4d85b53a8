"""ASTERIX of radars, made with libasterix."""

import struct
from functools import cache

import numpy as np

NS_PER_S = 10**9
DAY_S = 86_400


@cache
def category(number, edition=None):
    from asterix import generated

    known = generated.manifest["CATS"][number]
    return next((each for each in known if each.cv_edition == edition), known[-1])


def block(number, records, edition=None):
    """Return a data block of records, each a mapping of items, of the newest edition or another."""
    kind = category(number, edition)
    made = [kind.cv_record.create(dict(record)) for record in records]
    return kind.create(made).unparse().to_bytes()


def ticks(time_s):
    """Return a time of day in 1/128 s."""
    return round(time_s * 128) % (DAY_S * 128)


def plot(azimuth_deg, time_s, range_nm=50.0, sac=1, sic=2, **items):
    """Return the items of a plot of CAT048; others by their names, ``i070=...``."""
    given = {name.removeprefix("i"): value for name, value in items.items()}
    return {
        "010": (("SAC", sac), ("SIC", sic)),
        "140": ticks(time_s),
        "020": ((3, 0, 0, 0, 0, None),),
        "040": (("RHO", range_nm), ("THETA", round(azimuth_deg / 360.0 * 2**16) % 2**16)),
        **given,
    }


def plots(*records):
    return block(48, records)


def service(kind, time_s, sac=1, sic=2, **items):
    """Return a data block with a service message; other items by their names, ``i020=...``."""
    given = {name.removeprefix("i"): value for name, value in items.items()}
    who = (("SAC", sac), ("SIC", sic))
    return block(34, [{"010": who, "000": kind, "030": ticks(time_s), **given}])


def sector(azimuth_deg, time_s, **who):
    return service(2, time_s, i020=round(azimuth_deg / 360.0 * 256) % 256, **who)


def north(time_s, rotation_s=None, **who):
    revolution = {} if rotation_s is None else {"i041": round(rotation_s * 128)}
    return service(1, time_s, **revolution, **who)


def site(latitude, longitude, height, **who):
    """Return a data block with a north mark and the radar's position."""
    return service(1, 0.0, i120=(("HGT", height), ("LAT", latitude), ("LON", longitude)), **who)


def revolutions(count, sectors=32, rotation_s=4.0, start_s=1000.0, seen=(), **who):
    """Yield the data blocks of some revolutions from north on, each sector's plots and then its
    crossing.

    `seen` are pairs of azimuth and range, degrees and nautical miles, that are seen in every
    revolution.
    """
    yield north(start_s, rotation_s=rotation_s, **who)
    width = 360.0 / sectors
    for number in range(count * sectors):
        begin, end = number * width, (number + 1) * width
        found = [
            plot(azimuth, start_s + (number // sectors + azimuth / 360.0) * rotation_s, far, **who)
            for azimuth, far in seen
            if begin <= number // sectors * 360.0 + azimuth < end
        ]
        if found:
            yield plots(*found)
        yield sector(end % 360.0, start_s + (number + 1) / sectors * rotation_s, **who)


def final(data, time_s, board=0, line=0):
    """Return data blocks in an envelope of the final format."""
    time = round(time_s * 100).to_bytes(3, "big")
    return struct.pack(">HBBB", len(data) + 12, board, line, 0) + time + data + b"\xa5" * 4


def packet(data, sender="10.0.0.1", receiver="239.1.1.1", port=8600, vlan=False):
    addresses = bytes(int(part) for name in (sender, receiver) for part in name.split("."))
    udp = struct.pack(">HHHH", 40000, port, len(data) + 8, 0) + data
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(udp), 0, 0x4000, 1, 17, 0) + addresses
    tag = b"\x81\x00\x00\x07" if vlan else b""
    return b"\x01\x00\x5e\x01\x01\x01" + b"\x02" * 6 + tag + b"\x08\x00" + ip + udp


def pcap(packets, order="<", nanoseconds=False):
    """Return a capture; `packets` are pairs of time in nanoseconds and packet."""
    magic = 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
    parts = [struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65535, 1)]
    for time_ns, data in packets:
        part = time_ns % NS_PER_S if nanoseconds else time_ns % NS_PER_S // 1000
        head = time_ns // NS_PER_S, part, len(data), len(data)
        parts.append(struct.pack(order + "IIII", *head) + data)
    return b"".join(parts)


def pcapng(packets, order="<"):
    """Return a capture of the newer kind, with times in nanoseconds."""

    def entry(kind, body):
        body += bytes(-len(body) % 4)
        size = struct.pack(order + "I", len(body) + 12)
        return struct.pack(order + "I", kind) + size + body + size

    section = struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1)
    options = struct.pack(order + "HHB3xHH", 9, 1, 9, 0, 0)
    parts = [entry(0x0A0D0D0A, section)]
    parts.append(entry(1, struct.pack(order + "HHI", 1, 0, 65535) + options))
    for time_ns, data in packets:
        sizes = len(data), len(data)
        head = struct.pack(order + "IIIII", 0, time_ns >> 32, time_ns & 0xFFFFFFFF, *sizes)
        parts.append(entry(6, head + data))
    return b"".join(parts)


def random_record(layout, rng):
    """Return the bytes of a record with a random selection of random items, and their places."""
    from phd_jdtc_ros.asterix import specification

    known = [k for k, rule in enumerate(layout.rules) if rule is not None]
    known = [k for k in known if not isinstance(layout.rules[k], specification.RandomFieldSequence)]
    chosen = sorted(rng.choice(known, size=rng.integers(1, len(known) + 1), replace=False))
    octets = bytearray(chosen[-1] // 7 + 1)
    for place in chosen:
        octets[place // 7] |= 0x80 >> place % 7
    for index in range(len(octets) - 1):
        octets[index] |= 1
    body = b"".join(_random_item(layout.rules[place], rng) for place in chosen)
    return bytes(octets) + body, [layout.names[place] for place in chosen]


def _random_item(rule, rng):
    from phd_jdtc_ros.asterix import specification

    def noise(size):
        return bytearray(rng.bytes(size))

    if isinstance(rule, specification.Fixed):
        return bytes(noise(rule.size))
    if isinstance(rule, specification.Repetitive):
        count = int(rng.integers(0, 4))
        return count.to_bytes(rule.count_size, "big") + bytes(noise(count * rule.entry_size))
    if isinstance(rule, specification.Explicit):
        size = int(rng.integers(1, 9))
        return bytes([size]) + bytes(noise(size - 1))
    if isinstance(rule, specification.Compound):
        known = [k for k, sub in enumerate(rule.rules) if sub is not None]
        chosen = [k for k in known if rng.random() < 0.5]
        octets = bytearray(max(chosen, default=0) // 7 + 1)
        for place in chosen:
            octets[place // 7] |= 0x80 >> place % 7
        for index in range(len(octets) - 1):
            octets[index] |= 1
        return bytes(octets) + b"".join(_random_item(rule.rules[k], rng) for k in chosen)
    chained = isinstance(rule, specification.RepetitiveFx)
    parts = [rule.entry_size] * 4 if chained else list(rule.parts)
    count = int(rng.integers(1, len(parts) + 1))
    found = bytearray()
    for index, size in enumerate(parts[:count]):
        part = noise(size)
        last = index == count - 1
        if not last or chained or rule.last_extends or count < len(parts):
            part[-1] = part[-1] & 0xFE | (not last)
        found += part
    return bytes(found)


def rng(seed):
    return np.random.default_rng(seed)
