# SPDX-License-Identifier: Apache-2.0
"""Mesh files of a URDF: found, fitted by solids once, and the solids kept in the user's cache folder."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import logging
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.common.regular_file import NotRegularFileError, open_regular
from cable_ros.scene.errors import SceneError
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Sphere
from cable_ros.share import package_file

if TYPE_CHECKING:
    from cable_ros.scene.mesh_fit import Fit

KINDS = ("stl", "dae", "obj")
MOST_BYTES = 64_000_000
MOST_TRIANGLES = 500_000
_SOLIDS: dict[str, Any] = {kind.__name__: kind for kind in (Sphere, Capsule, Cylinder, Box)}


def find(name: str, folder: Path | None) -> Path:
    """The file of a URDF's mesh.

    A package that the ament index does not know is sought as a folder of its name above the URDF.

    Args:
        name: `package://PACKAGE/FILE`, `file://FILE`, or a path, relative to the URDF's folder.
        folder: of the URDF; None if its text was given.

    Raises:
        FileNotFoundError: one clause that says what is missing.
    """
    if name.startswith("package://"):
        try:
            return package_file(name)
        except FileNotFoundError:
            package, _, file = name.removeprefix("package://").partition("/")
            for above in folder.resolve().parents if folder else ():
                for place in (above, above / package):
                    if place.name == package and (place / file).is_file():
                        return place / file
            raise
    path = Path(name.removeprefix("file://")).expanduser()
    if path.is_absolute():
        return path
    if folder is None:
        raise FileNotFoundError("its path is relative, and nobody knows to what; use package:// or file://")
    return folder / path


def fitted(path: Path, scale: np.ndarray, source: str, place: str, fit_new: bool = True) -> Fit:
    """Solids for the mesh in a file, from the cache if it is known there.

    Args:
        path: of an STL, DAE or OBJ file.
        scale: (3,) factors along the mesh's axes.
        source, place: how messages name the URDF, and the collision in it.
        fit_new: whether to fit solids that are not kept yet.

    Raises:
        SceneError: one sentence: the file cannot be used, its solids are not kept, or a library is missing.
    """
    data = _read(path, source, place)
    try:
        from cable_ros.scene import mesh_fit
    except ImportError as error:
        raise SceneError(
            source, place, f"its mesh needs trimesh; pip install 'cable_ros[mesh]' (the import said: {error})"
        ) from None
    key = hashlib.sha256(repr((mesh_fit.VERSION, path.suffix.lower(), scale.tolist())).encode() + data)
    kept = cache_folder() / f"{key.hexdigest()}.json"
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        return _fit(json.loads(kept.read_text(encoding="utf-8")))
    if not fit_new:
        raise SceneError(
            source, place, f"its mesh {path} has no solids yet; cable compile SCENE fits them, once"
        )
    mesh = _mesh(data, path, scale, source, place)
    logging.getLogger(__name__).warning("Fitting solids to %s, once: up to a minute.", path)
    found = mesh_fit.fit(mesh)
    with contextlib.suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=kept.parent, delete=False, encoding="utf-8") as file:
            json.dump(_plain(found), file)
        os.replace(file.name, kept)
    return found


def cache_folder() -> Path:
    """Where solids are kept; whatever is in it may be deleted."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cable_ros" / "meshes"


def _read(path: Path, source: str, place: str) -> bytes:
    if path.suffix.lower().lstrip(".") not in KINDS:
        raise SceneError(source, place, f"its mesh {path} is none of {', '.join(KINDS)}")
    try:
        with io.BufferedReader(open_regular(path)) as file:
            data = file.read(MOST_BYTES + 1)
    except NotRegularFileError:
        raise SceneError(source, place, f"its mesh {path} is no regular file") from None
    except OSError as error:
        raise SceneError(source, place, f"its mesh {path} cannot be read ({error.strerror})") from None
    if len(data) > MOST_BYTES:
        raise SceneError(
            source, place, f"its mesh {path} has more than {MOST_BYTES} bytes; give a coarser one"
        )
    return data


def _mesh(data: bytes, path: Path, scale: np.ndarray, source: str, place: str) -> Any:
    import trimesh

    try:
        # From bytes: nothing that the file names, such as a texture, is opened.
        scene = trimesh.load_scene(io.BytesIO(data), file_type=path.suffix.lower().lstrip("."))
        mesh = scene.to_mesh()
        if scene.units not in (None, "meters"):
            mesh.apply_scale(trimesh.units.unit_conversion(scene.units, "meters"))
    except ImportError as error:
        raise SceneError(
            source, place, f"its mesh {path} needs '{error.name}'; pip install 'cable_ros[mesh]'"
        ) from None
    except Exception as error:
        detail = " ".join(str(error).split())[:200]
        raise SceneError(source, place, f"its mesh {path} cannot be read ({detail})") from None
    if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
        raise SceneError(source, place, f"its mesh {path} has no triangles of finite numbers")
    if len(mesh.faces) > MOST_TRIANGLES:
        raise SceneError(
            source, place, f"its mesh {path} has more than {MOST_TRIANGLES} triangles; give a coarser one"
        )
    mesh.apply_scale(scale)
    size = float(mesh.extents.max())
    if not 1e-4 <= size <= 100.0:
        raise SceneError(
            source, place, f"its mesh {path} is {size:.4g} m large; set its scale, such as 0.001 0.001 0.001"
        )
    return mesh


def _plain(fit: Fit) -> dict[str, Any]:
    solids = [
        {"kind": type(solid).__name__, **{k: np.asarray(v).tolist() for k, v in vars(solid).items()}}
        for solid in fit.solids
    ]
    return {"solids": solids, "outside": fit.outside, "bare": fit.bare}


def _fit(values: dict[str, Any]) -> Fit:
    """What `_plain` wrote. Raises ValueError, KeyError or TypeError where it is damaged."""
    from cable_ros.scene.mesh_fit import Fit

    solids = []
    for one in values["solids"]:
        kind = _SOLIDS[one.pop("kind")]
        if set(one) != {field.name for field in dataclasses.fields(kind)}:
            raise ValueError(one)
        arrays = {k: np.array(v, float) if isinstance(v, list) else float(v) for k, v in one.items()}
        if not all(np.isfinite(v).all() for v in arrays.values()):
            raise ValueError(one)
        solids.append(kind(**arrays))
    if not solids:
        raise ValueError(values)
    return Fit(tuple(solids), float(values["outside"]), float(values["bare"]))
