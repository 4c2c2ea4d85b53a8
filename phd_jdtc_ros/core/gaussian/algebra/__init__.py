# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Operations on arrays of Gaussians: products, moments, and their compiled loops."""
