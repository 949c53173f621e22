# SPDX-License-Identifier: Apache-2.0
"""Which effects a cable has, and what they make of it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any, cast

import numpy as np

from cable_ros.effects.effect import Effect, Environment, Properties
from cable_ros.scene import EFFECTS, Cable, Scene

ALL: tuple[Effect, ...] = tuple(cast(Effect, import_module(f"cable_ros.effects.{name}")) for name in EFFECTS)
"""The module of this folder that each name of `scene.EFFECTS` means."""


def called_for(scene: Scene, cable: Cable) -> tuple[str, ...]:
    """Names of the effects that the scene's numbers call for, whatever its `effects` says."""
    return tuple(effect.NAME for effect in ALL if effect.cause(scene, cable))


def wanted(scene: Scene, cable: Cable) -> tuple[str, ...]:
    """Names of the effects that are called for and that its `effects` lets in; `auto`: all at first."""
    names = called_for(scene, cable)
    return names if isinstance(scene.effects, str) else tuple(n for n in names if n in scene.effects)


def properties(
    scene: Scene, cable: Cable, names: Iterable[str] | None = None, environment: Environment | None = None
) -> Properties:
    """The cable with the named effects (default: the wanted ones).

    Raises:
        ValueError: a value of the environment is not within its table.
    """
    names = wanted(scene, cable) if names is None else tuple(names)
    out = Properties(cable.length, cable.stiffness, np.zeros(3))
    for effect in ALL:
        if effect.NAME in names:
            out = effect.add(out, scene, cable, environment or {})
    return out


def environments(
    scene: Scene, before: Mapping[str, Environment], values: Mapping[str, Any]
) -> dict[str, dict[str, float]]:
    """The environment of every cable by name, after `values` have changed it.

    Args:
        scene: whose cables name what they depend on.
        before: the environment of every cable until now.
        values: by the name of an influence, for all cables that depend on it; or, by a cable's name, a
            mapping of such values for that cable.

    Raises:
        ValueError: one sentence; nothing has changed.
    """
    depends = {
        cable.name: {i.name: i for i in (cable.temperature, cable.dose) if i is not None}
        for cable in scene.cables
    }
    out = {name: dict(before.get(name, {})) for name in depends}
    for key, value in values.items():
        if isinstance(value, Mapping):
            if key not in depends:
                raise ValueError(f"there is no cable '{key}'; the cables are {', '.join(depends)}")
            new = {(key, name): number for name, number in value.items()}
        else:
            new = {(cable, key): value for cable, names in depends.items() if key in names}
            if not new:
                raise ValueError(_nothing_depends(f"no cable depends on '{key}'", depends.values()))
        for (cable, name), number in new.items():
            influence = depends[cable].get(name)
            if influence is None:
                known = [depends[cable]]
                raise ValueError(_nothing_depends(f"cable '{cable}' does not depend on '{name}'", known))
            try:
                number = float(number)
            except (TypeError, ValueError):
                number = math.nan
            if not math.isfinite(number):
                raise ValueError(f"{name} of cable '{cable}' must be a finite number in {influence.unit}")
            try:
                influence.factors(number)
            except ValueError as error:
                raise ValueError(f"{name} of cable '{cable}': {error}") from None
            out[cable][name] = number
    return out


def _nothing_depends(fact: str, depends: Iterable[Iterable[str]]) -> str:
    known = sorted({name for names in depends for name in names})
    return (
        f"{fact}; it is {' and '.join(known)} that the scene has tables for"
        if known
        else (f"{fact}: the scene gives it no table")
    )
