"""The way back over a window, with text for rows: who is received what by whom, in which order."""

from phd_jdtc_ros.core.window.backward_pass import smoothed_sets
from phd_jdtc_ros.core.window.entries import Entry, Source


def smoothed(*entries):
    """Return the smoothed sets, newest first; each has what it was received in brackets."""

    def send(later, link):
        return f"{later} by {link}"

    def receive(own, received):
        parts = [
            f"{part.rows}:{part.part.start}-{part.part.stop} {part.content}" for part in received
        ]
        return f"{own}({'; '.join(parts)})"

    return list(smoothed_sets(entries, send, receive))


def test_messages_go_through_links_newest_first():
    first = Entry(10, "a")
    second = Entry(20, "b", (Source(10, None, 3),), "ab")
    third = Entry(30, "c", (Source(20, None, 2),), "bc")
    b = "b(None:0-2 c by bc)"
    assert smoothed(first, second, third) == ["c", b, f"a(None:0-3 {b} by ab)"]
    second = Entry(20, "b", (Source(10, (0,), 1),), "x")
    third = Entry(30, "c", (Source(10, (1,), 1),), "y")
    assert smoothed(first, second, third)[-1] == "a((1,):0-1 c by y; (0,):0-1 b by x)"
    second = Entry(20, "b", (Source(10, None, 1),), None)
    third = Entry(30, "c", (Source(5, None, 1),), "gone")
    fourth = Entry(40, "d", (Source(20, None, 1),), "bd")
    assert smoothed(first, second, third, fourth) == ["d", "c", "b(None:0-1 d by bd)", "a"]


def test_sources_of_a_scan_receive_their_own_parts_of_one_message():
    first, second = Entry(10, "a"), Entry(20, "b")
    gone, some, every = Source(5, None, 4), Source(10, (1, 2), 2), Source(20, None, 7)
    third = Entry(30, "c", (gone, some, every), "link")
    assert smoothed(first, second, third) == [
        "c",
        "b(None:6-13 c by link)",
        "a((1, 2):4-6 c by link)",
    ]
