# SPDX-License-Identifier: Apache-2.0
"""Minimisation that knows no cable."""
