# SPDX-License-Identifier: Apache-2.0
"""Other people's methods, written up to compare with: they share nothing with the solver."""
