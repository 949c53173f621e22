# SPDX-License-Identifier: Apache-2.0
"""The baselines, against equilibria that were found in other ways."""
