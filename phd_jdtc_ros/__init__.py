# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joint detection, tracking and classification of targets with radars, live on ROS 2."""

__version__ = "0.1.0"
