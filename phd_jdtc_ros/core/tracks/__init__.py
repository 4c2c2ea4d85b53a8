# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the targets of a filter to tracks: labels, numbers, confirmation and what is reported."""
