# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Code that the nodes share: start and stop, parameters, QoS overrides."""
