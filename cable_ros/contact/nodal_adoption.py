# SPDX-License-Identifier: Apache-2.0
"""A rod whose contacts sit at fixed material points takes over another rod's equilibrium and its friction."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.nodal_contacts import FIRST
from cable_ros.contact.nodal_kernels import tangent_frame
from cable_ros.contact.nodal_newton import CONVERGED
from cable_ros.contact.nodal_solver import NodalSolver
from cable_ros.contact.points import NEAR_LIMIT
from cable_ros.rod.kirchhoff import Rod

SEED = 2e-5
"""Maximum motion of what sticks, L, while an equilibrium of another rod is taken over: it hardly moves, and
friction along a patch hardly changes."""
FAINT = 1e-2
"""Friction, EI / L^2, that counts as none in that."""
PIECES = 3
"""Number of places along a cell among which its force is spread for a grid of other cells: shared from the
middles alone, cells of the twin differ by 12 % in friction."""


class NodalAdoption(NodalSolver):
    """A rod that can stand where another one does."""

    def adopt(self, rod: Rod, q: np.ndarray, F: np.ndarray, arc_lengths: np.ndarray, forces: np.ndarray,
              obstacles: np.ndarray) -> bool:  # fmt: skip
        """Take over another rod's equilibrium (q, F) with its friction; whether that succeeded.

        Args:
            rod: among the same obstacles, see `set_conditions`.
            arc_lengths: (c,) of its contacts.
            forces: (c, 3) on the cable.
            obstacles: (c,) which obstacle each contact is with.
        """
        assert rod.obstacles is not None
        state, m = self.state, len(self.h)
        fresh = rod.mesh.interpolate(q, self.mesh.nodes)
        fresh[0], fresh[-1] = q[0], q[-1]
        # neighbours on one side of the sphere of unit quaternions
        signs = np.cumprod(np.sign(np.concatenate(([1.0], np.sum(fresh[1:] * fresh[:-1], axis=1)))))
        state.q[:] = fresh * signs[:, None]
        weight = rod.f * np.arange(m - 1, -1, -1)[:, None] / self.cells
        nodal = self._shared(arc_lengths, forces, obstacles)
        if self.soft:
            # where its points are follows from the forces as the grid has them, and what sticks stays there
            state.F[:] = F + _behind(np.arange(m + 1.0), nodal.sum(axis=1), np.arange(m)) + weight
        else:
            state.F[:] = F + _behind(arc_lengths, forces, self.s0 + 0.5 * self.h) + weight
        self._integrate()
        state.lam[:], state.tau[:] = 0.0, 0.0
        self.obstacles, self._under, self._moved = rod.obstacles, rod.obstacles, False
        self.frames[:] = FIRST
        n, d, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        for k, o in np.argwhere(nodal.any(axis=2)):
            gap(self._under[o], state.r[k], n, d, bends)
            tangent_frame(n, FIRST, d)
            self.frames[k, o] = d[0]
            state.lam[k, o] = max(nodal[k, o] @ n, 0.0)
            state.tau[k, o] = d @ nodal[k, o]
        self._slide_on(rod.obstacles[:, FRICTION_COEFFICIENT])
        self.set_conditions(rod.qe, rod.re, rod.f)
        give = SEED / np.maximum(state.lam * rod.obstacles[:, FRICTION_COEFFICIENT], FAINT)
        solved = self._solve(rod.qe, rod.re, rod.f, rod.obstacles, 0.0, give)[0] == CONVERGED
        if not solved and not len(arc_lengths):
            # what touches nothing may be free to turn, and is at rest as it is
            self._slips[:], self._step = False, None
            self.refactor(state.q, state.F[-1])
        elif not solved and self._flow(rod.qe, rod.re, rod.f, rod.obstacles, give) is None:
            return False
        return True

    def _slide_on(self, mu: np.ndarray) -> None:
        """Let what is near its limit slide on: nothing moves in a takeover, so nothing comes to rest.

        The solve that follows shares normal forces otherwise, and one contact may come to bear those of its
        neighbours. With the friction of them all before, what slides stays at its limit.

        `mu`: (o,) coefficients of friction.
        """
        lam, tau = self.state.lam, self.state.tau
        around = lam.copy()
        around[1:] += lam[:-1]
        around[:-1] += lam[1:]
        size = np.linalg.norm(tau, axis=2)
        slides = (size > NEAR_LIMIT * mu * lam) & (mu * lam > 0.0)
        tau[slides] *= ((mu * around)[slides] / size[slides])[:, None]

    def _shared(self, arc_lengths: np.ndarray, forces: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
        """(m + 1, o, 3) forces (c, 3) at arc lengths (c,) shared by the two boundaries beside each."""
        m, out = len(self.h), np.zeros((len(self.h) + 1, len(self._under), 3))
        low = np.clip(np.searchsorted(self.s0, arc_lengths, "right") - 1, 1, m - 2)
        share = np.clip((arc_lengths - self.s0[low]) / self.h[low], 0.0, 1.0)[:, None]
        np.add.at(out, (low, obstacles), (1.0 - share) * forces)
        np.add.at(out, (low + 1, obstacles), share * forces)
        return out

    def _spread(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Arc lengths (c,), forces (c, 3) and obstacles (c,) of its contacts, those of patches in PIECES."""
        contacts = self.contacts()
        places = (np.arange(PIECES) + 0.5) / PIECES - 0.5
        arc_lengths = contacts.arc_lengths[:, None] + contacts.lengths[:, None] * places
        forces = np.repeat(contacts.forces / PIECES, PIECES, axis=0)
        return arc_lengths.ravel(), forces, np.repeat(contacts.obstacles, PIECES)


def _behind(places: np.ndarray, forces: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m, 3) sums of the forces (c, 3) at `places` (c,) that are greater than `at` (m,)."""
    order = np.argsort(places, kind="stable")
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(forces[order], axis=0)))
    return np.asarray(sums[-1] - sums[np.searchsorted(places[order], at, "right")])
