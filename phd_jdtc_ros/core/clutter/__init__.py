# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of false detections: their rate, their amplitudes, and a map of their places."""
