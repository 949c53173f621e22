# SPDX-License-Identifier: Apache-2.0
"""How much a scene and a URDF may hold: far more than any robot needs, and what can be read in seconds."""

MOST_SCENE_CHARACTERS = 200_000
MOST_URDF_CHARACTERS = 32_000_000

MOST_VALUES = 50_000
"""Fields, entries and numbers of a YAML text, aliases counted where they are used."""
DEEPEST_VALUE = 40
"""Nesting of a YAML text."""
MOST_MERGED = 1000
"""Fields that `<<` may bring together in one mapping."""

MOST_CABLES = 100
MOST_OBSTACLES = 1000
MOST_ROWS = 1000
"""Rows of a table."""
LONGEST_TEXT = 4096
"""Characters of a name or a path."""

MOST_ELEMENTS = 300_000
DEEPEST_ELEMENT = 100
"""Elements of a URDF, and their nesting."""
MOST_LINKS = 10_000
LONGEST_CHAIN = 500
"""Joints, fixed ones too, between the root and a link; at 20,000 the URDF's parser ends the process."""
MOST_MOVING = 150
"""Joints that move a clamp or an obstacle; Pinocchio's memory grows with their cube, 8 GB at 500."""
FARTHEST_ORIGIN = 1e4
"""m or rad, of a joint's origin."""
