# SPDX-License-Identifier: Apache-2.0
"""A rod among obstacles: contact points on an active set, and contacts at fixed material points."""
