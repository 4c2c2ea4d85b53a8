"""rosbag2 bags in MCAP: reproducible writing, and reading that salvages damaged files.

::

    writer                 writes a bag as rosbag2 does, the same bytes for the same content
    reader                 the files of a bag, and their messages in order of log time
    salvage                the content of a file, from its summary or record by record; unpacks
                           one piece within bounds
"""

from __future__ import annotations

from phd_jdtc_ros.quoting import short


class BagError(Exception):
    """The bag cannot be used; the message is one line of bounded length with bag and reason.

    `corrupt` says whether the file is damaged, rather than missing or of another kind.
    """

    def __init__(self, message: str, corrupt: bool = False) -> None:
        super().__init__(short(message))
        self.corrupt = corrupt
