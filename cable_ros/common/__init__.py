# SPDX-License-Identifier: Apache-2.0
"""Small things that know nothing of cables, which any folder may use."""
