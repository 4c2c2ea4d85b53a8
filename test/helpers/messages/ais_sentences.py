"""Sentences of AIS, made bit by bit from the tables of ITU-R M.1371, and of SBS-1."""

# Widths of the fields before the name of a field, in bits, of a position report of class A.
CLASS_A = (("type", 6), ("repeat", 2), ("mmsi", 30), ("status", 4), ("turn", 8), ("speed", 10))
CLASS_A += (("accuracy", 1), ("longitude", 28), ("latitude", 27), ("course", 12), ("heading", 9))
CLASS_A += (("second", 6), ("spare", 5), ("raim", 1), ("radio", 19))
CLASS_B = (("type", 6), ("repeat", 2), ("mmsi", 30), ("spare", 8), ("speed", 10), ("accuracy", 1))
CLASS_B += (("longitude", 28), ("latitude", 27), ("course", 12), ("heading", 9), ("second", 6))
CLASS_B += (("rest", 29),)
COARSE = (("type", 6), ("repeat", 2), ("mmsi", 30), ("accuracy", 1), ("raim", 1), ("status", 4))
COARSE += (("longitude", 18), ("latitude", 17), ("speed", 6), ("course", 9), ("rest", 2))
VOYAGE = (("type", 6), ("repeat", 2), ("mmsi", 30), ("version", 2), ("imo", 30), ("call", 42))
VOYAGE += (("name", 120), ("ship", 8), ("bow", 9), ("stern", 9), ("port", 6), ("starboard", 6))
VOYAGE += (("epfd", 4), ("eta", 20), ("draught", 8), ("destination", 120), ("rest", 2))
NAME = (("type", 6), ("repeat", 2), ("mmsi", 30), ("part", 2), ("name", 120), ("rest", 8))
STATIC = (("type", 6), ("repeat", 2), ("mmsi", 30), ("part", 2), ("ship", 8), ("vendor", 42))
STATIC += (("call", 42), ("bow", 9), ("stern", 9), ("port", 6), ("starboard", 6), ("rest", 6))
BASE = (("type", 6), ("repeat", 2), ("mmsi", 30), ("year", 14), ("month", 4), ("day", 5))
BASE += (("hour", 5), ("minute", 6), ("second", 6), ("accuracy", 1), ("longitude", 28))
BASE += (("latitude", 27), ("rest", 34))
LETTERS = "@ABCDEFGHIJKLMNOPQRSTUVWXYZ[\\]^_ !\"#$%&'()*+,-./0123456789:;<=>?"


def checksum(body):
    found = 0
    for byte in body.encode():
        found ^= byte
    return f"{found:02X}"


def text(words, bits):
    """Return a text as a number of six bits a letter."""
    found = 0
    for letter in words.ljust(bits // 6, "@"):
        found = found << 6 | LETTERS.index(letter)
    return found


def sentences(layout, number="3", talker="AIVDM", longest=60, **fields):
    """Return the sentences of a message, whose other fields are zero."""
    bits = "".join(f"{fields.pop(name, 0) & (1 << size) - 1:0{size}b}" for name, size in layout)
    assert not fields
    fill = -len(bits) % 6
    bits += "0" * fill
    values = [int(bits[k : k + 6], 2) for k in range(0, len(bits), 6)]
    payload = "".join(chr(value + 48 + 8 * (value >= 40)) for value in values)
    parts = [payload[k : k + longest] for k in range(0, len(payload), longest)]
    found = []
    for index, part in enumerate(parts, start=1):
        several = number if len(parts) > 1 else ""
        last = fill if index == len(parts) else 0
        body = f"{talker},{len(parts)},{index},{several},A,{part},{last}"
        found.append(f"!{body}*{checksum(body)}".encode())
    return found


def degrees(value, per_degree=600_000):
    return round(value * per_degree)


def class_a(mmsi, second, latitude=54.5, longitude=10.25, kind=1, talker="AIVDM", **fields):
    """Return the sentence of a position report of class A."""
    place = {"latitude": degrees(latitude), "longitude": degrees(longitude)}
    usual = {"speed": 123, "course": 451, "heading": 47, "accuracy": 1}
    found = {**usual, **place, **fields}
    return sentences(CLASS_A, talker=talker, type=kind, mmsi=mmsi, second=second, **found)[0]


def class_b(mmsi, second, latitude=54.5, longitude=10.25):
    place = {"latitude": degrees(latitude), "longitude": degrees(longitude)}
    return sentences(CLASS_B, type=18, mmsi=mmsi, second=second, heading=511, **place)[0]


def coarse(mmsi, latitude=54.5, longitude=10.25):
    place = {"latitude": degrees(latitude, 600), "longitude": degrees(longitude, 600)}
    return sentences(COARSE, type=27, mmsi=mmsi, speed=12, course=45, **place)[0]


def voyage(mmsi, name, ship=70, hull=(100, 20, 10, 12), **more):
    sides = dict(zip(("bow", "stern", "port", "starboard"), hull, strict=True))
    return sentences(VOYAGE, type=5, mmsi=mmsi, name=text(name, 120), ship=ship, **sides, **more)


def tagged(sentence, seconds, station="st1"):
    """Return a sentence behind a tag block with the time of its receipt."""
    body = f"s:{station},c:{seconds}"
    return f"\\{body}*{checksum(body)}\\".encode() + sentence


def sbs(address="4CA2D6", kind=3, day="2021/03/04", time="05:06:07.123", **cells):
    """Return a line of SBS-1; cells are ``call_sign height speed course latitude longitude``."""
    names = ("call_sign", "height", "speed", "course", "latitude", "longitude")
    given = [str(cells.pop(name, "")) for name in names]
    assert not cells
    head = ["MSG", str(kind), "1", "1", address, "1", day, time, day, time]
    return ",".join([*head, *given, *[""] * 6]).encode()
