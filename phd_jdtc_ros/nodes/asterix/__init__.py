# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ASTERIX bridge: radars' UDP to clouds, estimates to UDP."""
