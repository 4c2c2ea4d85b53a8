import struct
from collections import Counter

from phd_jdtc_ros.asterix.transport import pcap, pcap_out
from phd_jdtc_ros.asterix.transport.pcap_out import Line

LINE = Line((10, 1, 2, 3), (239, 4, 5, 6), 8611)
SENT = [(1_772_445_600_123_456_000, b"first"), (1_772_445_601_000_001_000, b"second one")]


def capture():
    return pcap_out.header() + b"".join(pcap_out.packet(t, data, LINE) for t, data in SENT)


def test_capture_is_read_again():
    counts = Counter()
    found = list(pcap.packets(capture(), counts))
    assert not counts
    assert pcap.is_capture(capture()[:4])
    assert [(each.received_ns, each.data) for each in found] == SENT
    assert {each.source for each in found} == {"10.1.2.3 to 239.4.5.6:8611"}


def test_headers_have_a_checksum_that_is_right():
    for time_ns, data in SENT:
        ip = pcap_out.packet(time_ns, data, LINE)[16 + 14 :][:20]
        total = sum(struct.unpack(">10H", ip))
        assert (total & 0xFFFF) + (total >> 16) == 0xFFFF
