# SPDX-License-Identifier: Apache-2.0
"""The named hard cases of a Python file, run and written as a table."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from cable_ros.bench.baseline_share import METHODS, attempt
from cable_ros.bench.cases import Case, Outcome, run_case
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.fuzz import cold_case, tracked_case
from cable_ros.bench.markdown import markdown_table, write_between

HEAD = ("case", "expected", "status", "error", "iterations", "ms", *METHODS, "verdict")


class ZooError(ValueError):
    """The file holds no cases."""


def load_cases(path: Path) -> tuple[Case, ...]:
    """CASES of a Python file; its folder is put on the import path, as Python does for a script.

    Raises:
        ZooError: the file cannot be read or has no CASES.
    """
    if not path.is_file():
        raise ZooError(f"{path}: no such file; give a Python file with CASES, such as test/zoo.py")
    sys.path.insert(0, str(path.resolve().parent))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None, path
    assert spec.loader is not None, path
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    cases = getattr(module, "CASES", ())
    if not cases:
        raise ZooError(f"{path}: it defines no CASES; give a Python file with a tuple of that name")
    return tuple(cases)


def run_zoo(path: Path, markdown: Path | None, baselines: bool = True) -> int:
    """Run every case, print the table, write it into `markdown`; 0 where all passed."""
    from tqdm import tqdm

    outcomes, rows = [], []
    for warm in (cold_case(0, 0, 1e-4), tracked_case(0, 0, 1e-4, steps=3), contact_case(0, 0, 1e-4)):
        run_case(warm)  # compiling is not solving
    for case in tqdm(load_cases(path), desc="zoo", leave=False, disable=None):
        outcome = run_case(case)
        outcomes.append(outcome)
        rows.append(row(outcome, baselines))
    table = markdown_table(HEAD, rows)
    failed = [outcome for outcome in outcomes if not outcome.passed]
    summary = f"{len(outcomes) - len(failed)} of {len(outcomes)} cases passed."
    print(table)
    print()
    print(summary)
    for outcome in failed:
        print(f"  {outcome.case.name}: {outcome.fault}")
    if markdown is not None:
        write_between(markdown, "zoo", f"{summary}\n\n{table}\n")
    return 1 if failed else 0


def row(outcome: Outcome, baselines: bool) -> list[str]:
    """The cells of one case, as HEAD has them."""
    steps, case = outcome.steps, outcome.case
    counts = Counter(step.equilibrium.status.name for step in steps)
    status = next(iter(counts)) if len(steps) == 1 else ", ".join(f"{n} {c}" for n, c in counts.items())
    if math.isfinite(outcome.reference_error):
        error = f"{outcome.reference_error:.0e} ref."
    else:
        error = f"{outcome.verified_error:.0e}" if math.isfinite(outcome.verified_error) else ""
    iterations = max((step.equilibrium.iterations for step in steps), default=0)
    ms = [1e3 * step.seconds for step in steps] or [math.nan]
    time = f"{ms[0]:.1f}" if len(ms) == 1 else f"{np.median(ms):.2f}, most {max(ms):.0f}"
    compared = baselines and case.baselines and bool(steps) and steps[-1].equilibrium.status.trusted
    others = [
        attempt(name, steps[-1].rod, steps[-1].equilibrium).cell if compared else "" for name in METHODS
    ]
    return [
        case.name,
        case.expected,
        status or "",
        error,
        str(iterations),
        time,
        *others,
        "passed" if outcome.passed else "FAILED",
    ]
