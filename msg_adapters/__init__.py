# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Between ROS messages, MCAP bags and the core's values. Knows no node."""
