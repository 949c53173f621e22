# SPDX-License-Identifier: Apache-2.0
"""Compiled: what an active-set rod calls from Python; groups come as plain tuples, see `rod.entry_points`."""

from __future__ import annotations

from cable_ros.compilation import njit
from cable_ros.contact import assembly, interfaces
from cable_ros.contact.contact_state import ContactSet, History, kkt_of, shape_of
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.rod.rod_state import Section

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def assemble_kkt(shape, forces, section, obstacles, history, contacts, count, kkt):
    """See `assembly.assemble_kkt`; matrix and right-hand side, with friction as it is.

    Returns the number of constraint rows.
    """
    history = History(*history)
    # what slips does not begin to stick because nothing moves
    held = history.model == COULOMB
    total, _, _ = assembly.assemble_kkt(
        shape_of(shape), forces, Section(*section), obstacles, history,
        ContactSet(*contacts), count, kkt_of(kkt), True, held,
    )  # fmt: skip
    return total


@njit(**OPTIONS)
def point_forces(shape, F, contacts, count, Fe, acc):
    """See `assembly.point_forces`."""
    assembly.point_forces(shape_of(shape), F, ContactSet(*contacts), count, Fe, acc)


@njit(**OPTIONS)
def lowest(shape, s, reach, obstacle):
    """See `interfaces.lowest`."""
    return interfaces.lowest(shape_of(shape), s, reach, obstacle)
