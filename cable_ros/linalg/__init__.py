# SPDX-License-Identifier: Apache-2.0
"""Linear algebra that knows no cable."""
