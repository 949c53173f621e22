# SPDX-License-Identifier: Apache-2.0
"""A scene from YAML or from a mapping; every mistake is one sentence with file, field and remedy."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from cable_ros.scene.cables import CABLE, check_density, read_cable
from cable_ros.scene.caps import MOST_CABLES, MOST_OBSTACLES, MOST_URDF_CHARACTERS
from cable_ros.scene.errors import SceneError, suggestion
from cable_ros.scene.fields import Field, Size, vector
from cable_ros.scene.model import CLAMPED, EFFECTS, FREE, Cable, Robot, Scene
from cable_ros.scene.obstacles import OBSTACLE, RADIUS_WORDS, Obstacle, read_obstacles
from cable_ros.scene.placement import read_link
from cable_ros.scene.section import Section, describe, plain
from cable_ros.scene.text import check_amount, parse_yaml, read_text
from cable_ros.scene.urdf import link_names
from cable_ros.share import package_file

CABLE_FRICTION = Size("", 0.0, 2.0)

GRAVITY = Size("m/s^2", -500.0, 500.0, *["it looks like mm/s^2 or cm/s^2"] * 2)

ROBOT = (
    Field(
        "urdf", "text", "the path of the robot's URDF, relative to the scene",
        "File of the robot's URDF: a path, or `package://PACKAGE/FILE`.", "space_arm.urdf",
        extent="a file",
    ),
)  # fmt: skip

CABLE_CONTACT = (
    Field(
        "friction", "number", "the coefficient of friction, at least 0, or leave it out",
        "Coefficient of friction where two cables touch.", "0.3", default=0.0, size=CABLE_FRICTION,
    ),
)  # fmt: skip

SCENE = (
    Field(
        "robot", "mapping", "{urdf: FILE}", "The robot that moves clamps and obstacles.",
        "{urdf: space_arm.urdf}", default=None,
        absent="none; a link needs one, which the node can take from `robot_description`", inner=ROBOT,
    ),
    Field(
        "gravity", vector(3), "[x, y, z] in m/s^2, such as [0, 0, -9.80665]", "Gravity in the world.",
        "[0, 0, -9.80665]", size=GRAVITY,
    ),
    Field(
        "cables", "list of mappings", "a list of cables, see config/space_arm.yaml", "The cables.",
        "[{name: camera_cable, ...}]", extent=f"1 to {MOST_CABLES}, of different names", inner=CABLE,
    ),
    Field(
        "obstacles", "list of mappings", "a list of obstacles, or leave it out",
        "What the cables can touch.", "[{name: ground, ...}]", default=(), absent="none",
        extent=f"1 to {MOST_OBSTACLES}, of different names", inner=OBSTACLE,
    ),
    Field(
        "cable_radius", "text", " or ".join(RADIUS_WORDS),
        "Whether the cable's surface touches obstacles, or its centreline, as in Liu et al. (2018).",
        "count", default="count", words=RADIUS_WORDS,
    ),
    Field(
        "cable_contact", "true, false or mapping", "true, false or {friction: 0.3}",
        "Whether the cables touch each other and themselves, and with which friction, none if it is not "
        "told; if they do not touch, overlaps are told.",
        "{friction: 0.3}", default=False, absent="false", inner=CABLE_CONTACT,
    ),
    Field(
        "friction_model", "text", "coulomb or sliding",
        "Stick and slip, or the fully mobilised friction of (53) of Liu et al. (2018).",
        "coulomb", default="coulomb", words=("coulomb", "sliding"),
    ),
    Field(
        "effects", "text or list of texts", f"auto, all, or a list of {', '.join(EFFECTS)}",
        "Effects beyond bending and torsion: all that the scene has numbers for, those that matter at the "
        "tolerance (auto), or some.",
        "[weight, contact]", default="all", words=("auto", "all", *EFFECTS),
    ),
)  # fmt: skip
"""The fields of a scene file; those of mappings and lists are in `Field.inner`."""


def load_scene(
    scene: str | os.PathLike[str] | Mapping[str, Any], *, urdf: str | None = None, meshes: bool = True
) -> Scene:
    """Read a scene.

    Args:
        scene: path of a YAML file, or a mapping with the same fields. In a mapping, `robot.urdf` is
            relative to the working directory; in a file, to the file.
        urdf: the text of a URDF, as the topic robot_description has it; takes the place of `robot.urdf`.
        meshes: whether mesh files that the URDF names may be opened.

    Raises:
        SceneError: one sentence with file, field and remedy.
    """
    if isinstance(scene, Mapping):
        check_amount(scene, "scene")
        values, path, source = plain(scene), None, "scene"
        text = yaml.safe_dump(_dumpable(values), sort_keys=False, default_flow_style=None)
    else:
        path = Path(scene)
        source = str(path)
        text = read_text(path, source, "a scene in YAML")
        values = parse_yaml(text, source)
    top = Section(values, source, "", SCENE)
    # A mapping is made by a program, which may well compute with a weight that no planet has.
    gravity = top.vector("gravity", 3, bounded=path is not None)
    robot = _robot(top, path, urdf, meshes)
    links = link_names(robot.urdf, robot.source) if robot else None
    cables: list[Cable] = []
    for i, entry in enumerate(top.items("cables", MOST_CABLES)):
        cable = read_cable(entry, source, f"cables[{i}]", links)
        if path is not None:
            check_density(cable, source, f"cables[{i}]")
        for j, other in enumerate(cables):
            if other.name == cable.name:
                raise SceneError(
                    source,
                    f"cables[{i}].name",
                    f"'{cable.name}' is already the name of cables[{j}]; give each cable its own name",
                )
        cables.append(cable)

    def of_robot(section: Section) -> Sequence[Obstacle]:
        from cable_ros.scene import robot_obstacles  # SciPy's rotations take a quarter of a second

        nonlocal robot
        robot, found = robot_obstacles.read(section, robot, cables)
        return found

    obstacles = read_obstacles(
        top.items("obstacles", MOST_OBSTACLES),
        source,
        lambda section: read_link(section, links),
        top.choice("cable_radius"),
        of_robot,
    )
    friction_model = top.choice("friction_model")
    effects = _effects(top)
    if obstacles:
        _check_strain_with_contact(top, cables, obstacles, friction_model, effects)
        _check_free_start_with_friction(top, cables, obstacles, effects)
        _check_friction_with_supports(top, cables, obstacles, friction_model, effects)
    cable_contact, cable_friction = _cable_contact(top, effects)
    if cable_contact:
        _check_cable_contact(top, cables, obstacles, effects)
    if cable_friction:
        _check_cable_friction(top, cables, obstacles)
    return Scene(
        tuple(cables), gravity, robot, text, path, source, obstacles, friction_model, cable_contact, effects,
        cable_friction,
    )  # fmt: skip


def _check_strain_with_contact(
    top: Section, cables: list[Cable], obstacles: Sequence[Obstacle], friction_model: str,
    effects: str | tuple[str, ...],
) -> None:  # fmt: skip
    """Friction by the end's motion knows no strain. Between other things than clamps no friction of obstacles
    knows it, and contact knows no shear.
    """

    def both(*names: str) -> bool:
        return isinstance(effects, str) or set(names) <= set(effects)

    slides = friction_model == "sliding" and any(obstacle.friction for obstacle in obstacles)
    for i, cable in enumerate(cables):
        for name, field in (("stretch", "axial_stiffness"), ("shear", "shear_stiffness")):
            if getattr(cable, field) is not None and slides and both(name, "contact", "friction"):
                top.fail(
                    f"{name} and friction_model sliding cannot be combined; choose coulomb, leave "
                    f"{field} or the obstacles' friction out, or let 'effects' list one of the two",
                    f"cables[{i}].{field}",
                )
            if getattr(cable, field) is None or not both(name, "contact") or not cable.released:
                continue
            rubs = both("friction") and any(obstacle.friction for obstacle in obstacles)
            if rubs or name == "shear":
                where, what = ("rough obstacles", "their friction") if rubs else ("obstacles", "these")
                top.fail(
                    f"{name} among {where} is solved between clamps only, and there is {cable.released}; "
                    f"leave {field} or {what} out, or clamp the cable there",
                    f"cables[{i}].{field}",
                )


def _check_free_start_with_friction(
    top: Section, cables: list[Cable], obstacles: Sequence[Obstacle], effects: str | tuple[str, ...]
) -> None:
    """Positions count from the start, and what sticks can't while that moves."""
    if not any(one.friction for one in obstacles):
        return
    if not isinstance(effects, str) and not {"contact", "friction"} <= set(effects):
        return
    for i, cable in enumerate(cables):
        if cable.start.kind == FREE:
            top.fail(
                "a free start and friction of obstacles cannot be combined; tell the cable from its other "
                "end, so that its end is free, or leave 'friction' of the obstacles out",
                f"cables[{i}].start.kind",
            )


def _check_friction_with_supports(
    top: Section, cables: list[Cable], obstacles: Sequence[Obstacle], friction_model: str,
    effects: str | tuple[str, ...],
) -> None:  # fmt: skip
    """Friction by the end's motion knows no ends that turn and slide."""
    if friction_model != "sliding":
        return
    if not (isinstance(effects, str) or "friction" in effects) or not any(one.friction for one in obstacles):
        return
    for i, cable in enumerate(cables):
        for name, mount in (("start", cable.start), ("end", cable.end)):
            if mount.kind != CLAMPED:
                top.fail(
                    f"a {mount.kind} end and friction_model sliding cannot be combined; choose coulomb, "
                    "leave 'friction' of the obstacles out, or let 'effects' list what there is without it",
                    f"cables[{i}].{name}.kind",
                )
        for support in cable.supports:
            if support.couples:
                top.fail(
                    f"the {support.kind} '{support.name}' and friction_model sliding cannot be combined; "
                    "choose coulomb, leave 'friction' of the obstacles out, or let 'effects' list what there "
                    "is without it",
                    f"cables[{i}].supports",
                )


def _check_cable_contact(
    top: Section, cables: list[Cable], obstacles: Sequence[Obstacle], effects: str | tuple[str, ...]
) -> None:
    """Cables that touch each other are clamped at both ends, do not shear, and slide freely."""
    hint = "yet; leave one of the two out"
    if not (isinstance(effects, str) or "contact" in effects):
        top.fail("needs the effect contact; add it to 'effects'", "cable_contact")
    if any(obstacle.friction for obstacle in obstacles) and (
        isinstance(effects, str) or "friction" in effects
    ):
        top.fail(f"friction of obstacles and cable_contact cannot be combined {hint}", "cable_contact")
    names = {cable.name for cable in cables}
    for i, cable in enumerate(cables):
        for name, given in (
            ("supports", bool(cable.supports)),
            ("shear_stiffness", cable.shear_stiffness is not None),
            ("start.kind", cable.start.kind != CLAMPED),
            ("end.kind", cable.end.kind != CLAMPED),
        ):
            if given:
                top.fail(f"this and cable_contact cannot be combined {hint}", f"cables[{i}].{name}")
    for i, obstacle in enumerate(obstacles):
        if obstacle.name in names:
            top.fail(
                "is the name of a cable, which cable_contact tells, too; give another", f"obstacles[{i}].name"
            )


def _cable_contact(top: Section, effects: str | tuple[str, ...]) -> tuple[bool, float]:
    """Whether cables touch each other, and their coefficient of friction, 0 without that effect."""
    if "cable_contact" in top and isinstance(top.get("cable_contact"), Mapping):
        friction = top.inner("cable_contact").number("friction")
        return True, friction if isinstance(effects, str) or "friction" in effects else 0.0
    return top.flag("cable_contact"), 0.0


def _check_cable_friction(top: Section, cables: list[Cable], obstacles: Sequence[Obstacle]) -> None:
    """Friction between cables is that of two cables of constant length, without obstacles."""
    hint = "yet; leave one of the two out"
    if obstacles:
        top.fail(f"friction between cables and obstacles cannot be combined {hint}", "cable_contact.friction")
    for i, cable in enumerate(cables):
        for name, given in (
            ("axial_stiffness", cable.axial_stiffness is not None),
            ("limits", cable.limits is not None),
        ):
            if given:
                top.fail(f"this and friction between cables cannot be combined {hint}", f"cables[{i}].{name}")


def _effects(top: Section) -> str | tuple[str, ...]:
    if "effects" not in top:
        return "all"
    names = ", ".join(EFFECTS)
    value = plain(top.get("effects"))
    if isinstance(value, str):
        if value not in ("auto", "all"):
            top.fail(
                f"'{top.text('effects')}' is not auto or all{suggestion(value, ('auto', 'all'))}", "effects"
            )
        return value
    if not isinstance(value, list):
        top.fail(f"must be {top.remedy('effects')}, not {describe(value)}", "effects")
    for i, name in enumerate(value):
        place = f"effects[{i}]"
        if name not in EFFECTS:
            hint = suggestion(name, EFFECTS) if isinstance(name, str) else ""
            shown = f"'{name}'" if isinstance(name, str) else describe(name)
            top.fail(f"there is no effect {shown}{hint}; give some of {names}", place)
        if name in value[:i]:
            top.fail(f"'{name}' stands here twice; keep one", place)
    if "friction" in value and "contact" not in value:
        top.fail("friction needs contact; add contact, or take friction out", "effects")
    return tuple(value)


def _robot(top: Section, path: Path | None, urdf: str | None, meshes: bool) -> Robot | None:
    section = Section(top.values["robot"], top.source, "robot", ROBOT) if "robot" in top else None
    if urdf is not None:
        return Robot(urdf, "robot description", meshes=meshes)
    if section is None:
        return None
    name = section.text("urdf")
    if name.startswith("package://"):
        try:
            file = package_file(name)
        except FileNotFoundError as error:
            section.fail(f"{name}: {error}", "urdf")
    else:
        file = Path(name).expanduser()
        if path is not None:
            file = path.parent / file
    place = f"{top.source}: {section.at('urdf')}: {file}"
    return Robot(read_text(file, place, "the robot's URDF", MOST_URDF_CHARACTERS), str(file), file)


def _dumpable(values: Any) -> Any:
    """A mapping that YAML can hold, for the scene's text; the sections report what is wrong with it."""
    if isinstance(values, Mapping):
        return {
            key if isinstance(key, str) else describe(key): _dumpable(value) for key, value in values.items()
        }
    if isinstance(values, list):
        return [_dumpable(value) for value in values]
    if isinstance(values, int) and not isinstance(values, bool):
        return values if abs(values) < 10**20 else describe(values)
    return values if isinstance(values, bool | int | float | str) or values is None else str(values)
