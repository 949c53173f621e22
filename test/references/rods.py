# SPDX-License-Identifier: Apache-2.0
"""Known equilibria on meshes of one's choice, in units of the cable."""

from __future__ import annotations

from functools import cache

import numpy as np

from cable_ros.branch.cold_start import Found, settle
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.kirchhoff import Rod
from cable_ros.solve.trust_region import Options
from references.equilibria import KNOWN

STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
"""A start clamp whose frame is the world's."""


def equal(order: int, count: int) -> Mesh:
    """`count` equal elements."""
    return Mesh(reference_element(order), np.full(count, 1.0 / count))


@cache
def reference(name: str) -> Found:
    """The equilibrium with an error far below anything compared here (estimated 1e-13)."""
    return KNOWN[name].solved(1e-11)


def uniform(name: str, order: int, count: int) -> Found:
    """The same equilibrium on equal elements of any order."""
    near, mesh = reference(name), equal(order, count)
    rod = Rod(mesh, near.rod.K)
    rod.set_conditions(near.rod.qe, near.rod.re, near.rod.f)
    q = near.rod.mesh.interpolate(near.q, mesh.nodes)
    q[0], q[-1] = near.q[0], near.q[-1]
    found = settle(rod, q, near.F, Options(step_tolerance=1e-12, constraint_tolerance=1e-13))
    assert found is not None
    return found
