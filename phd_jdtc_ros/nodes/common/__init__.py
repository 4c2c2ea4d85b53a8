# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared code of the nodes: start and stop, parameters, QoS overrides."""
