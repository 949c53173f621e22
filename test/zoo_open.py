# SPDX-License-Identifier: Apache-2.0
"""Named hard cases beside the zoo: too slow for it, or not had yet.

    cable bench robustness --zoo test/zoo_open.py

`test_zoo.py` does not count them. Nor does it a drum that turns back under a taut rod that stretches by 1e-4
(test/contact/test_stretching_friction.py): with some last bits of its angles exact contact and grid differ by
6 to 9 %, and the pose is not published. Nor friction of 1e-4 on a rod that stretches so, of whose effect a
third is lost with some BLAS kernels as the mesh changes.
"""

from __future__ import annotations

from dataclasses import replace

from zoo_drawn import thin_floor
from zoo_hose import OPEN

from cable_ros.bench.drawn import drawn_case

DRAWN = {
    (100, 21): "over rough beams, both edges of each: two points in one element, off by 7.2e-4 at two poses",
    (91, 37): "a tray, dragged along: a grid's error is too large",
    (101, 2): "a rough lift leaves the ground at its clamp and falls: two poses are reported, then 5 %",
    (103, 23): "a rough lift: a step in which slip turns back is 2.1 % off, it says 0.7 %",
    (104, 38): "a rough ball pushed up: five poses are reported, and 2.8 % on a finer path",
    (108, 35): "over rough beams: held off the shortest path by friction, and not followed to a pose",
    (108, 61): "a ball pushed up under a rough cable until that is taut: in two poses the branch is lost",
    (109, 5): "an edge on a grid is said to stick and has moved 1.1e-3 of the length",
    (110, 27): "a ball pushed up until a rough cable is taut: a grid's error is too large",
    (111, 51): "a rough lift in four poses: it slides off, how far depends on the steps",
    (113, 8): "a rough ball pushed up under a cable: a grid's error is too large",
    (115, 297): "a rough ball pushed up, down and up: the branch is lost",
    (117, 35): "between rough rollers, all but taut: it slides 2.7e-3 L the way its friction pushes",
    (120, 20): "a lift that lies on the ground in full, led aside: 2.1 % off, and sticks where it has moved",
    (120, 38): "a loop that touches itself, on a rough table: which way it forks depends on the steps",
    (123, 58): "beams pushed up under a rough cable until it is taut: the branch is lost on a finer path",
    (134, 12): "smooth beams pushed up until taut: the judge does not know whether a path is short enough",
    (135, 5): "a rough ball pushed up until the cable is taut: the branch is lost",
    (135, 47): "a hose led about in six poses: its grid's error is too large",
    (136, 37): "a rough drum pushed up until the cable is taut: with some last bits a pose is lost",
    (137, 8): "a heavy lift at its last pose, on a grid whose error is 5.3 %",
    (140, 33): "heavy, over rough beams, pulled until taut: 96 % of the way to a pose",
    (144, 29): "weightless, over rough beams, pulled until taut: a pose is reported",
    (153, 140): "over smooth beams: the branch is lost at a fold",
    (158, 88): "a rough ball pushed up under a heavy cable: a pose is reported, the next is lost",
    (158, 451): "heavy, over rough beams: two poses on a grid whose error is too large, and 6.3 % for 5 %",
    (158, 460): "a heavy lift led aside: eleven poses are on a grid whose error is too large",
    (159, 113): "a rough ball pushed up until a cable is taut, told in 4 times as many poses: 1.8 %",
    (159, 646): "a heavy cable in a rough corner: off by 2.1e-4 at six poses, asked for 1e-4",
    (159, 760): "a rough ball pushed up until a heavy cable is taut, told 4 times as finely: 1.7 %",
    (162, 14): "a rough ball pulls a heavy cable taut, off the shortest path: five poses are reported",
    (163, 43): "a heavy rough lift turns back, told in 4 times as many poses: 2 % with some kernels",
    (163, 132): "a heavy rough lift: a contact slides 1.5e-3 L the way its friction pushes, at one pose",
    (163, 189): "over a smooth beam: a pose is just on a fold, and rounding tells whether it has snapped",
    (163, 401): "a hose led about in eleven poses: the branch is lost",
    (163, 535): "heavy, over a smooth edge: the start's wrench is off by 5.5e-4, asked for 5e-4",
    (163, 630): "a rough ball pushed up until a cable is taut: a grid's error is too large at 14 poses",
    (164, 1097): "a rough ball pushed up until a heavy cable is taut: one pose is reported",
    (164, 1132): "a heavy cable on a rough tray: a contact slides 1.7e-4 L the way its friction pushes",
    (164, 1310): "a heavy cable on a rough ball, told in 4 times as many poses: 1.6 % at one pose",
    (164, 1767): "a heavy rough lift in seven poses: a grid's error, 5.9 %, is too large at one",
    (164, 1775): "taut over rough rollers, told in 4 times as many poses: 1.7 % at one pose",
    (164, 1783): "a rough ball pushed up until the cable is taut: 17 poses are reported",
    (164, 1814): "over a rough beam, told in 4 times as many poses: it is lost for a while, then 4 % off",
    (164, 1834): "a heavy cable over a rough edge: the start's wrench is off by 5.9e-4, asked for 5e-4",
    (165, 131): "taut over rough rollers: 15 poses are reported, and one is 2.8 % off on a finer path",
    (165, 405): "a rough lift in 17 poses: it falls, told in 4 times as many it is lost",
    (165, 667): "a heavy rough lift in nine poses, told in 4 times as many: 2 % with some digits",
    (165, 750): "on a rough drum: which of two images it takes hangs on how the path is told",
    (165, 759): "a rough ball pulls a heavy cable taut: one pose is reported, one 2.1 % off",
    (165, 860): "rough beams pushed up until the cable is taut: the branch is lost",
    (165, 935): "a rough ball pushed up: the branch is lost with some digits of its joints",
    (166, 65): "a heavy rough lift in nine poses, told in 4 times as many: 1.1 % at one pose",
    (166, 366): "heavy, over a rough beam in three poses: one is reported",
    (166, 509): "rough beams pushed up until the cable is taut: reported, and on the way back, too",
    (167, 37): "a rough lift: beside its clamp a contact is said to stick and has moved 1.7e-3 L",
    (167, 340): "over a smooth edge: 1.0e-6 of the length inside at two poses of 201",
    (167, 460): "a heavy rough lift: three poses are 1.0 % off, the last one is reported",
    (167, 677): "heavy, taut over rough beams: it could not be followed, and 32 poses are reported",
    (167, 694): "rough beams pull a heavy cable taut: ten poses are reported",
    (169, 39): "heavy, over rough beams, told in 4 times as many poses: 5.9 % at one, it says 4.6 %",
    (169, 1130): "over smooth beams: off by 3.6e-4 at one pose, asked for 1e-4",
    (169, 1156): "taut over rough rollers in 101 poses, told in 4 times as many: 1.5 % at two",
    (170, 42): "a rough ball pushed up: three poses are reported, one is 1.1 % off",
    (170, 66): "rough rollers pushed up and down, told in 4 times as many poses: 1.5 % at one pose",
    (170, 120): "a hose led there and back: a contact slides 1.2e-4 L the way its friction pushes",
    (170, 176): "a hose led there and back, told in 4 times as many poses: 1.0 % at one pose",
    (170, 201): "in a rough slot, told in 4 times as many poses: 1.0 % at four poses",
    (170, 305): "a rough lift in 41 poses, told in 4 times as many: 1.4 % at the last one",
    (171, 254): "a heavy rough lift in ten poses: four are reported, for an error of 21 %",
    (171, 261): "a rough lift falls, and told in 4 times as many poses is lost",
    (171, 320): "a rough ball pushed up until the cable is taut: three poses are reported",
    (172, 158): "a heavy lift turns back where it falls: 0.5 % of friction decide whether it has fallen",
    (172, 190): "taut over rough beams: three poses are reported",
    (172, 363): "a rough ball pulls a cable taut within a pose: six are reported, one is 6.5 % off",
    (173, 318): "along a rough ball in 11 poses, told in 4 times as many: 1.2 % at one, two are reported",
    (173, 805): "a rough ball pulls a cable taut and lets go: 6.8 % off, and nine poses are reported",
    (173, 897): "over rough rollers, told in 4 times as many poses: 1.6 % at one",
    (173, 1104): "along a rough ball: two poses on a grid are reported",
    (173, 1294): "a rough ball pulls a weightless cable taut: seven poses are reported",
    (173, 1522): "a heavy cable over rollers, taut: a pose is reported, one is 1.2 % off",
    (173, 1567): "a rough ball pulls a cable taut: six poses are reported",
    (173, 1637): "a rough ball pushed down under a cable that it pulled taut: 1.9 % off, then lost",
    (175, 46): "a rough ball first touched, told in 4 times as many poses: 1.0 % at one",
    (175, 94): "on a rough ball a point is not where it is deepest: 2.4e-6 of the length inside beside it",
    (175, 118): "a rough ball pulls a heavy cable taut: two poses are reported",
    (175, 188): "along a rough wall, told in 4 times as many poses: 1.4 % at four",
    (175, 254): "a heavy rough lift, which begins on a grid: 1.7 % at one pose, it says 1.9 %",
    (175, 341): "taut over smooth rollers, at 1.8e6 EI / L^2: lost on the way back on a finer path",
    (175, 424): "a rough ball pushed up, on whose side a cable sticks: four poses are said to be taut",
    (175, 1064): "a rough ball pushed up until a cable is taut: a step too far, and eight poses are reported",
    (175, 1193): "a lift there and back, told in 4 times as many poses: 1.1 % at two",
    (175, 1194): "taut over rough rollers, told in 4 times as many poses: 2.1 % at one",
    (175, 1398): "across a rough ball, told in 4 times as many poses: 2.0 % at three",
    (175, 1651): "a heavy lift led aside, told in 4 times as many poses: 1.1 % at two",
    (175, 1870): "a rough ball pulls a cable taut: 1.4 % at a pose, eighteen are reported",
    (175, 1880): "over smooth beams: rightly said to be taut at a pose, which the judge does not confirm",
    (176, 163): "a rough ball pulls a cable taut within a pose: 8 % off, it says 3 %",
    (177, 42): "a heavy cable across a rough table: an equilibrium that is not stable is reported",
    (177, 202): "a heavy lift, told in 4 times as many poses: 3.0 % at the first",
    (177, 291): "over rough beams, told in 4 times as many poses: 1.3 % at the last one",
    (177, 345): "a lift falls, and told in 4 times as many poses is lost",
    (178, 44): "a rough ball pushed up: three poses are reported",
    (178, 137): "rough beams pushed up until a heavy cable is taut: a pose is reported",
    (178, 259): "over rough beams, pulled taut and led back: a pose is reported",
    (178, 479): "over a rough beam: a grid's error, 51 to 93 %, refuses four poses",
    (178, 49): "a ball pulls a cable taut, told in 4 times as many poses: the branch is lost",
    (179, 75): "a ball pulls a heavy cable taut, told in 4 times as many poses: 1.3 % at one, then lost",
    (179, 118): "a heavy rough table, told in 4 times as many poses: 1.3 % at four",
    (179, 245): "a ball led along a rough cable, told in 4 times as many poses: 1.4 % at one",
    (179, 417): "a ball pushed up under a rough cable until that is taut: three poses are reported",
    (179, 451): "a ball led across under a rough cable until it is taut: 13 reported, 1.1 % at four",
    (179, 495): "a lift led aside: at one of 201 poses off by 9.6e-4, asked for 1e-4",
    (179, 496): "a hose led round, told in 4 times as many poses: it slides as its friction pushes",
    (179, 606): "a hose led round: the start wrench is off by 0.6 % at one pose",
    (179, 611): "rough beams pushed up: 18 poses are reported, five are 1 to 12 % off, it says 2 to 5 %",
    (181, 136): "a rough lift falls, told in 4 times as many poses: 3.0 % at one, it says 3.1 %",
    (181, 362): "over rough beams: 1.7e-6 of the length inside one, at a pose",
    (181, 582): "on a rough tray: a contact slides the way its friction pushes, at one pose",
    (182, 99): "a light rough lift falls, told in 4 times as many poses: 3.2 % at three, it says 6 %",
    (183, 59): "along a rough wall, told in 4 times as many poses: 1.4 % at one, it says 0.3 %",
    (184, 482): "a heavy lift led to and fro, told in 4 times as many poses: 1.0 % at one, it says 1.3 %",
    (184, 623): "back from taut over rough beams: 5.7, 3.8 and 1.1 % at three poses, it says 7 %",
    (184, 802): "a hose in 4 times as many poses: 1.6 % at one; it slides as friction pushes at another",
    (184, 926): "told in 4 times as many poses: 1.3 % at one, it says 0.3 %",
}
"""By seed and index of `drawn_case`, what is amiss."""
OF_A_KIND = {
    (156, 0, "rollers"): "taut over rough rollers, at 3e6 EI / L^2: 4.5 %, told in 4 times as many poses",
    (154, 9, "ball"): "a light cable on a rough ball: it falls, and friction is forgotten",
}
"""By seed, index and kind."""

CASES = (
    *OPEN,
    replace(thin_floor(0.001), name="a weightless loop that rests without force, led aside"),
    *(replace(drawn_case(*key, 1e-4), name=f"drawn {key}: {what}") for key, what in DRAWN.items()),
    *(
        replace(drawn_case(seed, index, 1e-4, kind), name=f"drawn {kind} {seed}, {index}: {what}")
        for (seed, index, kind), what in OF_A_KIND.items()
    ),
)
