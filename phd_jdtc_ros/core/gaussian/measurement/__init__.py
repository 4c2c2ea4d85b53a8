# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measurement update of Gaussians: gates, pairs, linearisation, amplitudes and births."""
