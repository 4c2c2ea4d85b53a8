# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""rosbag2 bags in MCAP: written reproducibly, read whatever has happened to them.

::

    writer                 a bag as rosbag2 writes it, the same bytes for the same content
    reader                 messages in order of time, every intact chunk of a damaged file
    mcap_index, salvage    what a file holds, by its summary or record by record
    chunks                 one chunk, unpacked within bounds
    errors                 why a bag was refused
"""
