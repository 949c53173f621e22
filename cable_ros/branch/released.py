# SPDX-License-Identifier: Apache-2.0
"""Cold start and snap-through of a cable with pins, rings and tubes: clips in their place are released."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_ros.branch.balance import HELD, Balance
from cable_ros.branch.cold_start import Found
from cable_ros.branch.coupled_state import Shared, first_guess, reachable
from cable_ros.branch.hanging import ASIDE, plausible
from cable_ros.branch.landing import BESIDE
from cable_ros.branch.loose_ends import Surface, Tip
from cable_ros.branch.release import Release, descend
from cable_ros.branch.shared_piece import Place
from cable_ros.branch.viscous_fall import ViscousFall
from cable_ros.contact.distance import nearest
from cable_ros.equilibrium import Status
from cable_ros.scene import Kinematics

SLIDE, MOST_SLIDES = 0.05, 200
"""Step of a cable that friction does not hold, as a fraction of the shortest piece, and their number."""
CREEP, FOLD, MOST_FALLS = 1e-5, 0.1, 10
"""Minimum such step; where even that leads nowhere there is a fold, and the cable falls: how far beyond, as a
fraction of the longest step, and how often at most."""
WINDING, LEAST_WINDING = 0.25, 1e-3
"""First and smallest step in which a given moment grows, as parts of it."""
SLIGHT = 1e-3
"""Maximum slack, as a fraction of the length, of a cable that is all but straight, and distance of its end
from what it is about to stand on."""
LEANS = 1e-10
"""Distance, as a fraction of the length, by which the end of a straight cable is off to a side."""
ROOM = 0.8
"""Part of the room to that side, with a cable stretched out, that its end is given."""
ROUGH = 1e-4
"""Tolerance of an equilibrium whose ends are to be released, if not that which is asked for."""
UNRESOLVED = "An equilibrium was found, but not to the tolerance {:g}."


class Released(ViscousFall):
    """A run with the searches for another equilibrium."""

    def _start(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray
    ) -> tuple[Status, str, int] | None:
        """Find an equilibrium: clips in the place of all supports, then released.

        None, or status and message of the piece that failed, and its number here. That with clips is only a
        beginning where ends move far, so that a rough one will do.
        """
        exact = self.pieces[0].tolerance
        if not self.loose:
            return self._search(kinematics, joints, mounts)
        for piece in self.pieces:
            piece.tolerance = max(exact, ROUGH)
        problem = self._search(kinematics, joints, mounts)
        for piece in self.pieces:
            piece.tolerance = exact
        if problem is not None or exact >= ROUGH:
            return problem
        resolved = [piece.resolve() for piece in self.pieces]
        if all(resolved):
            self._inverse = self._judged_at = None
            assert self.state is not None
            found = self._newton(kinematics, joints, mounts, self.state)
            if found is not None and self._stable(kinematics, joints, mounts, found):
                self._accept(joints, found)
                return None
        self.state = None
        return Status.NOT_CONVERGED, UNRESOLVED.format(exact), 0

    def _search(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray
    ) -> tuple[Status, str, int] | None:
        """See `_start`, to the tolerance of the pieces."""
        length, problem = self.run.length, None
        for tips, hanging in self._tips(kinematics, joints, mounts):
            Balance.reset(self)
            held = mounts.copy()
            for tip in tips:
                held[-tip.which, tip.which] = tip.pose(mounts[-tip.which, tip.which])
            arcs = np.array([support.arc_length for support in self.run.supports])
            guess = first_guess(held, reachable(held, arcs, length, self._guides), length, self._tubes)
            guess = guess._replace(tips=tips)
            places = guess.places(mounts, length)
            if hanging is not None:
                if self._adopt(kinematics, joints, mounts, guess, places[0], hanging):
                    return None
                continue
            for i, (piece, place) in enumerate(zip(self.pieces, places, strict=True)):
                found = piece.find(kinematics, joints, place)
                if not found.converged:
                    problem = problem or (found.status, found.message, i)
                    break
            else:
                self._joints, self.state = joints, guess
                if self._snap(kinematics, joints, mounts):
                    return None
                what = "ends" if self.loose else "supports"
                message = f"No stable equilibrium was found as its {what} were released."
                problem = Status.NOT_CONVERGED, message, 0
        self.state = None
        return problem or (Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, 0)

    def _tips(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray
    ) -> Iterator[tuple[tuple[Tip, ...], Found | None]]:
        """Where loose ends may be at first, see `hanging.Begin`; nothing, once, without any."""
        if not self.loose:
            yield (), None
            return
        rows = self._rows(kinematics, joints)
        for begin in plausible(self.run, self.loose, self._loose_piece(0), mounts, rows):
            pairs = [(end, mounts[-end.which, end.which]) for end in self.loose]
            yield tuple(end.tip(begin.poses[end.which], mount) for end, mount in pairs), begin.found

    def _adopt(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, guess: Shared, place: Place,
        hanging: Found,
    ) -> bool:  # fmt: skip
        """Take an equilibrium of the only piece, at `place`, that hangs clear of all obstacles.

        Whether it is one here.
        """
        if not self._loose_piece(0).adopt(kinematics, joints, place, hanging):
            return False
        self._joints, self.state = joints, guess
        self._keep()
        found = self._newton(kinematics, joints, mounts, guess)
        if found is None or not self._stable(kinematics, joints, mounts, found):
            return False
        self._accept(joints, found)
        self._steps = ()
        return True

    def _snap(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> bool:
        """Descend the energy from the last equilibrium to a stable one; whether one was found.

        Friction of obstacles is left out on the way, and begins at nothing.
        """
        assert self.state is not None
        if self._stands and self._lifted(kinematics, joints, mounts):
            return True
        for piece in self.pieces:
            piece.rub(False)
        self._slips = [False] * len(self.loose)
        self._wound = 0.0
        found = self._descended(kinematics, joints, mounts)
        if found is not None:
            found = self._wind(kinematics, joints, mounts, found)
        self._wound = 1.0
        for piece in self.pieces:
            piece.rub(True)
        if found is not None:
            self._accept(joints, found)
            self._steps = ()
        return found is not None

    def _lifted(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> bool:
        """Let go of what free ends rest on; whether there is a stable equilibrium so.

        A cable that stands on its end until it is drawn straight presses on the ground up to that moment.
        """
        assert self.state is not None
        faces, self._faces, self._inverse = self._faces, [None] * len(self.loose), None
        force = self.loose[-1].pull(mounts[-1, 1])
        self._loose_piece(-1).begin_with(force, self.state.places(mounts, self.run.length)[-1])
        found = self._newton(kinematics, joints, mounts, self._faced(kinematics, joints, self.state))
        if found is not None and not any(self._faces) and self._stable(kinematics, joints, mounts, found):
            self._accept(joints, found)
            self._steps = ()
            return True
        self._faces, self._inverse, self._judged_at = faces, None, None
        self._return()
        return False

    @property
    def _stands(self) -> bool:
        """Whether it rests on its free end and is all but straight there."""
        return bool(self._faces) and self._faces[-1] is not None and self.pieces[-1].slack < SLIGHT

    def _leant(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, state: Shared) -> Shared:
        """With the free end of a cable that is all but straight off to the side to which it leans.

        Pressed on a face it buckles to that side, however little it leans, and goes as far as there is room.
        """
        rows, piece = self._rows(kinematics, joints), self.pieces[-1]
        if rows is None or not self.loose or not self.loose[-1].free or piece.slack > SLIGHT:
            return state
        start, tip = state.places(mounts, self.run.length)[-1].poses[0, :3], state.tips[-1]
        beside = Surface.at(rows[nearest(rows, tip.position)[1]], tip.position)
        n, chord = beside.normal, tip.position - start
        drop, aside = chord @ n - beside.gap, chord - (chord @ n) * n
        room, size = piece.length**2 - drop**2, float(np.linalg.norm(aside))
        if beside.gap > SLIGHT * piece.length or not room > 4.0 * size**2:
            return state
        if size < LEANS * piece.length:
            aside = ASIDE - (ASIDE @ n) * n  # any side is as good
        there = start + drop * n + ROOM * np.sqrt(room) * aside / np.linalg.norm(aside)
        return state._replace(tips=(*state.tips[:-1], tip._replace(position=there)))

    def _descended(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> Shared | None:
        """The stable equilibrium that a descent from the last one ends at; None: none was found."""
        assert self.state is not None
        kept, self._steps = self._kept, ()
        self._slides[:] = 0
        found = self._fallen(kinematics, joints, mounts, self._leant(kinematics, joints, mounts, self.state))
        if found is not None:
            self.state = found
            found = self._let_slide(kinematics, joints, mounts)
        if found is None or not self._stable(kinematics, joints, mounts, found):
            self._kept = kept
            return None
        return found

    def _fallen(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, state: Shared
    ) -> Shared | None:
        """The minimum of the energy below a state without sliding; None: none was found."""
        self._inverse = self._judged_at = None
        if self._kept and self._move(kinematics, joints, mounts, state, fall=True, held=True) is None:
            return None

        def energy() -> float:
            return self._energy(mounts, state)

        def move(to: Shared, fall: bool) -> Shared | None:
            nonlocal state
            self._keep()
            faces, to = self._faces, self._caught(kinematics, joints, to, BESIDE)
            if self._move(kinematics, joints, mounts, to, fall, held=True) is None:
                self._return()
                self._faces = faces
                return None
            state = to
            return to

        def back(to: Shared) -> None:
            nonlocal state
            self._return()
            self._faces = [tip.touch for tip in to.tips]
            state = to

        def landed(at: Shared) -> Shared:
            nonlocal state
            if self._let_go(mounts, at):
                state = self._faced(kinematics, joints, at)
                return state
            return at

        release = Release(
            move, back, energy, lambda at: self.tangent(mounts, at), self.scale(), lambda: self.free, landed,
            self._turns_freely,
        )  # fmt: skip
        state = self._caught(kinematics, joints, self._faced(kinematics, joints, state), BESIDE)
        return descend(release, state)

    def _let_slide(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> Shared | None:
        """Let the cable slide in rings that do not hold it, until friction does; None: it slides too far.

        The pieces are at a state without sliding. What exceeds friction moves on in short steps, as a cable
        that creeps, until Newton's method finds where friction is just enough. At a fold on its way it falls.
        """
        longest, falls = SLIDE * min(piece.length for piece in self.pieces), MOST_FALLS
        step, way = longest, np.zeros(len(self._guides))
        for _ in range(MOST_SLIDES):
            assert self.state is not None
            self._slides[:], self._inverse = 0, None
            stuck = self._corrected(kinematics, joints, mounts, self.state)
            if stuck is not None:
                excess, signs = self._excess()
                over = self._guides & (self._friction > 0.0) & (excess > (1.0 + HELD) * self._friction)
                if not over.any():
                    return stuck
                self.state, way = stuck, signs * over
                self._keep()
                self._slides[over], self._inverse = signs[over], None
                slid = self._corrected(kinematics, joints, mounts, stuck)
                if (
                    slid is not None
                    and not (way * (slid.arcs - stuck.arcs) > 0.0).any()
                    and self._stable(kinematics, joints, mounts, slid)
                ):
                    return slid
                self._return()
                self._slides[:] = 0
                crept, step = self._crept(kinematics, joints, mounts, way, step)
                if crept is not None:
                    self.state, step = crept, min(2.0 * step, longest)
                    continue
            if not (way.any() and falls):
                return None
            self._return()
            beyond = self.state._replace(arcs=self.state.arcs - FOLD * longest * way)
            fallen = self._fallen(kinematics, joints, mounts, beyond)
            if fallen is None:
                return None
            self.state, step, falls = fallen, longest, falls - 1
        return None

    def _crept(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, way: np.ndarray, step: float
    ) -> tuple[Shared | None, float]:
        """What sticks, after at most a `step`, m, on its `way` (n,) through the rings, and that step.

        It still exceeds friction that way; None: it comes to a fold.
        """
        assert self.state is not None
        least = CREEP * min(piece.length for piece in self.pieces)
        while step > least:
            on = self.state._replace(arcs=self.state.arcs - step * way)
            crept = self._corrected(kinematics, joints, mounts, on)
            if crept is not None:
                now, towards = self._excess()
                if ((now > self._friction) & (towards * way > 0.0)).any():
                    return crept, step
            self._return()
            step *= 0.5
        return None, step

    def _energy(self, mounts: np.ndarray, state: Shared | None = None) -> float:
        """Of all pieces, J."""
        state = self.state if state is None else state
        assert state is not None
        places = state.places(mounts, self.run.length)
        whole = sum(piece.energy(place.poses) for piece, place in zip(self.pieces, places, strict=True))
        return whole + self._given(mounts, state)

    def _given(self, mounts: np.ndarray, state: Shared) -> float:
        """Potential, J, of the forces that are given at loose ends."""
        pairs = zip(self.loose, state.tips, strict=True)
        return sum(end.energy(tip, mounts[-end.which, end.which]) for end, tip in pairs)

    def _wind(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, found: Shared
    ) -> Shared | None:
        """Lead it on as given moments, which have no energy, grow from nothing; None: it ends."""
        if not any(end.mount.moment.any() for end in self.loose):
            return found
        self.state, at, step = found, 0.0, WINDING
        self._keep()
        while at < 1.0:
            self._wound, self._inverse, self._judged_at = min(1.0, at + step), None, None
            on = self._newton(kinematics, joints, mounts, self.state)
            if on is not None and self._stable(kinematics, joints, mounts, on):
                self.state, at, step = on, self._wound, 2.0 * step
                self._keep()
                continue
            self._return()
            step *= 0.5
            if step < LEAST_WINDING:
                return None
        return self.state
