# SPDX-License-Identifier: Apache-2.0
"""Compiled: from one equilibrium that touches to the next, by Newton's method on a changing active set."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF_ENTRY, njit
from cable_ros.contact.assembly import assemble_kkt
from cable_ros.contact.contact_state import ContactSet, History, Last, Options, Shape, kkt_of
from cable_ros.contact.coulomb_cones import hold, let_go, may_hold, slip_on_cones
from cable_ros.contact.detection import dipping, may_stay, release, update_active_set
from cable_ros.contact.flattening import flatten
from cable_ros.contact.force_updates import correct_forces, firmer, largest_change, sticks_now
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.interfaces import place_points, turned_since
from cable_ros.contact.moving_obstacles import follow_obstacles
from cable_ros.contact.patch_edges import meet_edges
from cable_ros.contact.patch_ends import merge, move_ends, shrink
from cable_ros.contact.patches import SAMPLES, coarse, cover, fill
from cable_ros.contact.pinches import meet_pinches
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FRICTION,
    KIND,
    NUMBER,
    POINT,
    SAMPLE,
    SLIPS,
    SWINGS,
    WAS,
)
from cable_ros.contact.stretched import close_strained_curve, trace
from cable_ros.linalg import banded
from cable_ros.linalg.bordered import (
    complement,
    complement_factors,
    end_coupling,
    give_way,
    is_minimum,
    kkt_matrix,
    kkt_multipliers,
    respond,
)
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import close_curve, lengthen
from cable_ros.rod.rod_state import Grid, Section, grid_of
from cable_ros.rod.warm_step import ADVANCED, NOT_CONTRACTING, NOT_CONVEX, TOO_FAR, close, largest

OPTIONS = {"cache": True, "error_model": "numpy"}

SLOW = 0.15
"""Refactor if an iteration leaves more than this fraction of the error."""
MOST_TURNS = 4
"""Maximum number of revisions in a row that undo each other: at a fold what lets go is inside once it has."""
MOST_REVISIONS, MOST_ITERATIONS, MOST_WITH_FRICTION, MOST_AGAINST_DRAG = 44, 25, 40, 80
"""Maximum number of changes of the active set in a solve, and of iterations between two of them."""
FRONT = 8
"""Maximum number of contacts that begin to slip in an iteration against drag beyond MOST_WITH_FRICTION: where
stick is stiff, slip spreads along a patch by a sample or two in each, and more of them go to and fro."""
IN_TURN, SHORT, STAYS, PULLS = 8, 1e4, 100.0, 5e-3
"""Number of such changes without friction after which a set is left as it is: in a step that turns the
cable by less than the first multiple of the tolerance, if they move it by less than the second, and nothing
pulls by more than this part of the end force. Where it all but rests, beside a patch's end, it touches and
does not, in turn, and only a finer mesh tells."""
LOOSE = 1e-2
"""Largest step, rad or over the end force, that ends the iterations where presliding is still halved."""
REVERSES = 4
"""How a step ends, beside the ways of `warm_step`, in which friction turns back nearly everywhere."""
REVERSED, AT_ONCE, REVERSED_FORCE = 20, 2, 0.5
"""Number of contacts more than which change between stick and slip in an iteration of such a step, the last
iteration in which they do, and the part of the largest force by which one changes. Shorter steps show what
comes to rest first; this one takes dozens of iterations and fails."""
DIRECTED, SWINGS_ON, ROUNDS = 30.0, 0.5, 5
"""Maximum error of a point's friction, over that of the end force; what is left of it after an iteration, as
the direction of a short slip follows the shape late; and how often more iterations are made for it."""
CALM = 1e-3
"""Rotation in an iteration, rad, over all that changed in the one before, below which only ends of patches
swing, not what sticks and slips in turn."""
STILL = 1e-11
"""Rotations in an iteration, rad, below which points may go on changing between stick and slip."""
ROUNDING, NOISE = 10.0, 100.0
"""Steps that stagnate below this multiple of the tolerance, or of STILL, are rounding error; and that of the
tolerance by which forces may go on changing then, over the end force, between the ends of a short patch."""
DENSE, MANY_ROWS = 45.0, 200.0
"""The square of this number of constraint rows takes as long as one unknown of the band, 2 us; and the number
from which on they cost as its third power."""
PATIENT, MOST_ON_CONES, NEARLY = 6, 12, 1e-10
"""Number of iterations in which points may find by themselves which of them stick and slip; of those in which
Coulomb's law tells, see `coulomb_cones`; and the step, as LOOSE, at which these end."""
LEAST_WORK = 80_000.0
"""Work that a solve may take however little is left, see `iteration_work`: 160 ms."""
MOST_IN_ALL, MOST_FROM_SOFT = 75, 160
"""Beyond this many iterations the active set is assumed to cycle; the same where presliding is halved,
and against drag."""


@njit(**INNER)
def skew_factor(kkt, count, order, drag):
    """`kkt_factor` where multipliers act along W, constraints read V; says nothing about stability.

    Args:
        kkt: `KKT`, whose factors are overwritten.
        count: number of constraint rows.
        order: of the elements.
        drag: weight of the elastic part that is added, see `Options.drag`.
    """
    elastic, geometric = kkt.tangents.elastic, kkt.tangents.geometric
    A, U, pivots, _, S = kkt.factors
    n = elastic.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + drag) * elastic[i, j] + geometric[i, j]
    banded.factor(A, 3, n - 3, order, U, pivots)
    complement(kkt.rows.V, kkt.rows.W, False, count, order, kkt.factors)
    give_way(S, kkt.strain.skew, kkt.strain.give, kkt.rows.delta, count)
    movers, shifts = kkt.rows.movers, kkt.rows.shifts
    for i in range(count):
        if movers[i] > 0:
            S[i, movers[i]] += shifts[i]


@njit(**OPTIONS)
def active_set_newton(last, conditions, obstacles, section, grid, contacts, kkt, options, control, new):
    """From an equilibrium with contact to the one under new conditions; see `warm_step.advance`.

    A tangent step from the old state, Newton's method on the active set, and changes of the set until no
    point pulls and nothing is too deep inside. The factors of an earlier equilibrium serve until a section
    has turned too far since or they no longer contract.

    Args:
        last: fields of `Last`, as a plain tuple, see `entry_points`; so are the next ones.
        conditions: of `Conditions`.
        obstacles: (o, WIDTH) the obstacles.
        section: of `Section`.
        grid: of `Grid`; contact moves its boundaries.
        contacts: of `ContactSet`, overwritten.
        kkt: of `KKT`, overwritten.
        options: of `contact_state.Options`.
        control: of `StepControl`.
        new: nodal frames (n, 4) and end force (3,), overwritten.

    Returns:
        How it ended, see `warm_step.advance` and REVERSES; numbers of iterations, contact points and
        constraint rows; whether another mesh would hold the points better; rotation since the last
        factorisation, and in the tangent step, rad.
    """
    last, section, grid, contacts = Last(*last), Section(*section), grid_of(grid), ContactSet(*contacts)
    kkt, options = kkt_of(kkt), Options(*options)
    q, F, f_old, obstacles_old, count, total_rows, ready, known, ratio, shift, q_then, _, _ = last
    q_new, F_new = new
    qe, re, f = conditions
    h, s0, tables = grid
    points, gaps, _ = contacts
    evaluation, tangents, rows, factors, strain = kkt
    V, totals = rows.V, evaluation.totals
    model, _, _, _, _, _, softest, samples, depth, give, finest, bubbles, drag, carried, _, budget = options
    tolerance, limit, rotation, refactor_at = control
    N = tables.values
    order = N.shape[1] - 1
    n = 3 * q.shape[0]
    gv = evaluation.g.reshape(n)
    s, b, y = np.empty(n), np.zeros(V.shape[0]), np.empty(V.shape[0])
    gone, pull = np.zeros(n), np.empty(n)  # rotations in this step, and what the medium exerts
    q_from, h_was, s0_was = q.copy(), h.copy(), s0.copy()  # from where `gone` counts
    elements = h.shape[0]
    cells = samples.shape[0] - 1
    spacing = 1.0 / cells
    phi = np.empty((obstacles.shape[0], cells + 1))
    covered = np.empty((obstacles.shape[0], SAMPLES * elements), np.bool_)
    cover(points, count, h, s0, covered)
    soft = strain.reach.shape[0] > 0  # a cable that stretches settles beside what stands there
    c = np.zeros((elements, N.shape[0] + 1, 4 if soft else 3))
    old_h, old_s0 = last.h_then.copy(), last.s0_then.copy()
    old_c = np.zeros((old_h.shape[0], c.shape[1], c.shape[2]))
    old = Shape(q_then, old_c, Grid(old_h, old_s0, tables))
    trace(old, (F, f_old), contacts, count, obstacles_old, strain)
    closed = np.zeros((old_h.shape[0], N.shape[0] + 3, 3))
    if soft:
        close_strained_curve(old, (F, f_old), contacts, count, strain.compliance, bubbles, closed)
    else:
        close_curve(q_then, old_h, bubbles, old_c, closed)
    if ratio != 1.0 or shift != 0.0:
        lengthen((old_c, closed, old_h, old_s0), ratio, shift)
    before = options.still, options.step, old_c, closed, old_h, old_s0, last.obstacles
    presliding = max(softest, options.presliding)
    history = History(model, options.direction, presliding, options.bedding, *before)
    shape = Shape(q_new, c, grid)
    for i in range(points.shape[0]):
        for a in range(3):
            points[i, BEFORE + a] = points[i, FRICTION + a]
        points[i, SWINGS] = 0.0
        points[i, WAS] = points[i, ARC_LENGTH] if points[i, KIND] == POINT else 0.0
        if points[i, KIND] != SAMPLE:
            points[i, NUMBER] = 0.0
        if softest > 0.0:
            points[i, SLIPS] = 0.0
    copy_rows(q, q_new)
    copy(F, F_new)
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[q.shape[0] - 1]), qe))
    total, rounds, size, step, scale, foreseen = 0, 0, 0.0, 0.0, 1.0, 0.0
    worked, most = 0.0, max(budget, LEAST_WORK)
    friction, slipped = np.empty((points.shape[0], 3)), np.empty(points.shape[0])
    small, swaps = factors.S, np.empty(0, np.int64)
    unsettled_before = 0.0
    since, F_then = 0.0, F.copy()  # rotation since the last set was solved, and its end force
    tangent, moved = True, False  # `tangent`: the tangent step, which moves the end
    least, worst = 0, 1.0
    may_rub = model == COULOMB and not soft and drag == 0.0 and presliding == 0.0 and may_hold(points, count)
    steady = model != COULOMB  # whether no direction of friction is part of the iteration
    holds, fresh, rate = ready, False, 0.0  # `holds`: the factors are those of the present set of points
    revised, turns = 0, 0  # contacts added in the last revision, and how often as many went as had come
    known = known and ready and (f == last.f).all() and (obstacles == last.obstacles).all()
    in_turn, in_all = MOST_ITERATIONS, MOST_FROM_SOFT if softest > 0.0 or drag > 0.0 else MOST_IN_ALL
    if model == COULOMB:
        in_turn = MOST_AGAINST_DRAG if drag > 0.0 else MOST_WITH_FRICTION
    for revision in range(MOST_REVISIONS):
        if total > in_all:
            return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen
        converged, on_cones, alone = False, 0, 0
        for iteration in range(in_turn):
            changes = 0
            trace(shape, (F_new, f), contacts, count, obstacles, strain)
            if not tangent:
                flattened, count = flatten(shape, spacing, obstacles, give, points, count)
                edged, count = meet_edges(shape, f, obstacles, spacing, (depth, give), points, count)
                moved = not place_points(shape, obstacles, spacing, contacts, count, (F_new, f), strain)
                released, count = release(shape, obstacles, points, count, False)
                shrunk, count = shrink(points, count, spacing, depth)
                merged, count = merge(points, count, spacing)
                changes, count = fill(points, count, h, s0, covered)
                pinched, count = meet_pinches(shape, obstacles, points, count)
                changes += pinched + flattened + edged + released + shrunk + merged
            holds = holds and changes == 0
            if on_cones > 0:
                hold(points, count, obstacles)
                holds = False
            full = not holds or (not tangent and (rotation > refactor_at or rate > SLOW))
            if not full:
                gaps[count : total_rows - 3] = 0.0
            new_rows, same, flips = 0, True, 0
            if not (tangent and known):
                new_rows, same, flips = assemble_kkt(
                    shape, (F_new, f), section, obstacles, history, contacts, count, kkt, full, tangent
                )
            if not full and (flips > 0 or (not tangent and not same)):
                full = True
                new_rows, same, _ = assemble_kkt(
                    shape, (F_new, f), section, obstacles, history, contacts, count, kkt, full, tangent
                )
            if iteration >= MOST_WITH_FRICTION and flips > FRONT:
                return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen
            if tangent and not known:
                follow_obstacles(contacts, count, rows, new_rows if full else total_rows)
            changes += flips
            if full:
                total_rows, holds, fresh, rotation = new_rows, True, True, 0.0
                steady = same or model != COULOMB
            if full and same:
                least, worst = kkt_matrix(
                    tangents, drag, order, factors, V, rows.delta, strain.reach, strain.give, total_rows,
                    3 + count,
                )  # fmt: skip
            elif full:
                skew_factor(kkt, total_rows, order, drag)
            if full or swaps.shape[0] != total_rows:
                small, swaps = complement_factors(factors.S, total_rows)
            if drag > 0.0 and not tangent:
                turned_since(q_from, h_was, s0_was, q_new, grid, gone)
                banded.multiply(tangents.elastic, gone, pull)
                for i in range(n):
                    gv[i] += drag * pull[i]
            b[:] = 0.0
            for a in range(3):
                b[a] = totals[a] - re[a]
                for k in range(3):
                    b[a] += strain.give[a, k] * (F_new[k] - F[k])
            for i in range(3, total_rows):
                b[i] = gaps[i - 3]
            if tangent:
                end_coupling(tangents, V, total_rows, theta, gv, b)
            kkt_multipliers(gv, b, V, order, factors, small, swaps, s, y)
            if on_cones > 0 and not slip_on_cones(
                (points, count, rows.lines), obstacles, history, small, swaps, y
            ):
                let_go(points, count)
                total, worked = total + 1, worked + iteration_work(n, total_rows)
                on_cones, holds, alone = 0, False, -MOST_IN_ALL
                continue
            respond(factors.Y, total_rows, y, s)
            if tangent:
                for k in range(3):
                    s[n - 3 + k] = theta[k]
            step = largest(s)
            foreseen = step if tangent else foreseen
            if not step <= limit:
                return TOO_FAR, total, count, total_rows, moved, rotation, foreseen
            rotation, since = rotation + step, since + step
            quaternion.retract(q_new, s, q_new)
            close(q_new, qe)
            if tangent and carried:
                copy_rows(q_new, q_from)
            change, couple, scale = correct_forces(contacts, count, y, rows, total_rows, F_new, soft)
            scale = max(scale, options.least)
            felt = max(step, couple / scale)
            calm = changes == 0 and felt < CALM * size
            ends, moment = move_ends(points, count, y, spacing, model == FRICTIONLESS or calm, calm)
            turned, unsettled = max(felt, ends), max(felt, change / scale)
            step = max(turned, change / scale)
            if not tangent:
                total, worked = total + 1, worked + iteration_work(n, total_rows)
                reversal = total <= AT_ONCE and flips > REVERSED and change > REVERSED_FORCE * scale
                if reversal and softest == 0.0 and drag == 0.0:
                    return REVERSES, total, count, total_rows, moved, rotation, foreseen
                rate = max(min(step / size, 1.0) if iteration > 0 and size > 0.0 else 0.1, rotation)
                if on_cones > 0:
                    size, on_cones = step, on_cones - 1
                    if step <= NEARLY or on_cones == 0:
                        let_go(points, count)
                        on_cones, holds = 0, False
                    continue
                alone += 1
                # where contact has changed in the step, slip is not what keeps it from settling
                if alone >= PATIENT and may_rub and count == last.size and may_hold(points, count):
                    on_cones, alone = MOST_ON_CONES, 0
                # the constraint rows may hold the direction of friction too stiffly
                trusted = rate if steady or full else max(rate, 0.5)
                enough = tolerance if presliding <= options.presliding else max(LOOSE, tolerance)
                stagnates = changes == 0 and iteration > 4 and step > 0.9 * size
                # the shape hardly depends on where a patch ends that does not press there
                judged = max(felt, max(moment, change) / scale) if stagnates else step
                # where all but nothing moves, rounding tells what sticks and what slips
                settled = changes == 0 or (changes == flips and turned < STILL)
                if settled and (judged * trusted <= enough or judged < 1e-13):
                    step, converged = judged, True
                    break
                if stagnates and turned <= ROUNDING * STILL and step <= NOISE * tolerance:
                    converged = True
                    break
                if stagnates and same and steady and turned <= ROUNDING * tolerance:
                    # the shape hardly depends on how neighbouring samples share their force
                    step, converged = turned, True
                    break
                # places of points that hardly differ swing while all else settles
                nearer = unsettled < 0.9 * unsettled_before
                if worked > most or (iteration > 12 and stagnates and not nearer and model == FRICTIONLESS):
                    return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen
            tangent = False
            size, unsettled_before = step, unsettled
        if not converged:
            return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen
        # the error of the iteration must not pass for penetration
        left = depth + step * rate
        trace(shape, (F_new, f), contacts, count, obstacles, strain)
        held, changed = count, False
        stays = model == FRICTIONLESS and revision >= IN_TURN
        stays = stays and foreseen <= SHORT * tolerance and since <= STAYS * tolerance
        for a in range(3):
            stays = stays and abs(F_new[a] - F_then[a]) <= ROUNDING * tolerance * scale
        slight = PULLS * scale
        if not (stays and may_stay(shape, samples, obstacles, 2.0 * give, points, count, slight, phi)):
            changed, count = update_active_set(
                shape, samples, obstacles, left, give + step * rate, points, count, phi
            )
        since = 0.0
        copy(F_new, F_then)
        turns = turns + 1 if (count - held) * revised < 0 else 0
        if turns > MOST_TURNS and model == FRICTIONLESS:
            return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen
        revised = count - held
        if not changed and presliding > options.presliding:
            presliding = firmer(points, count, obstacles, options, presliding)
            history = History(model, options.direction, presliding, options.bedding, *before)
        elif not changed:
            moved = moved or coarse(points, count, h, s0, finest) or dipping(points, count)
            judged = model == FRICTIONLESS and fresh
            if judged and not is_minimum(factors.S, rows.delta, total_rows, least, worst):
                return NOT_CONVEX, total, count, total_rows, moved, rotation, foreseen
            if model == COULOMB:
                for i in range(count):
                    slipped[i] = points[i, SLIPS]
                    for a in range(3):
                        friction[i, a] = points[i, FRICTION + a]
            assemble_kkt(shape, (F_new, f), section, obstacles, history, contacts, count, kkt, False, False)
            if model == COULOMB and rounds < ROUNDS:
                left = max(rate, SWINGS_ON) * largest_change(points, count, friction)
                # what sticks only now has the friction of the iteration before
                if left > DIRECTED * tolerance * scale or sticks_now(points, count, slipped):
                    rounds, holds = rounds + 1, False
                    continue
            return ADVANCED, total, count, total_rows, moved, 0.0 if fresh else rotation, foreseen
        size, rate, holds = 0.0, 0.0, False
    return NOT_CONTRACTING, total, count, total_rows, moved, rotation, foreseen


@njit(**LEAF_ENTRY)
def iteration_work(unknowns, rows):
    """Cost of an iteration, in unknowns of a rod without constraints, each of which takes 2 us."""
    return unknowns + rows * rows / DENSE * max(rows / MANY_ROWS, 1.0)
