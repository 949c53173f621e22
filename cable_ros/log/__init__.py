# SPDX-License-Identifier: Apache-2.0
"""Logs in MCAP: written, recovered, read and solved again."""
