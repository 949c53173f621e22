# SPDX-License-Identifier: Apache-2.0
"""The `cable` command: each file without an underscore is one of its commands."""
