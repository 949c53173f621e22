# SPDX-License-Identifier: Apache-2.0
"""From pose to pose: cold start, continuation, snap-through, and what is known of the branch."""
