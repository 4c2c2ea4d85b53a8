# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fixed-lag window of an engine: entries of past scans, the forward and the backward pass."""
