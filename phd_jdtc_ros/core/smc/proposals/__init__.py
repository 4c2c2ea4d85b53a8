# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where particles are drawn: by the motion, by range rates, at detections and at birth."""
