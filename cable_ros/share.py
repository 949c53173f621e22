# SPDX-License-Identifier: Apache-2.0
"""Where the installed scenes, launch files and layouts are, however the package was installed."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

PACKAGE = "cable_ros"
_MARKER = "package.xml"


def share_directory() -> Path:
    """Directory that holds `config/`, `launch/` and `package.xml` of this package.

    Searched in this order: the source tree that this code runs from (an editable or symlinked
    install: code and files then always match), the ament index, and the `share` folder of the
    environment that the package was installed into by pip.

    Raises:
        FileNotFoundError: in none of these places; the sentence names them.
    """
    code = Path(__file__).resolve().parent
    candidates = [code.parent]
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        index = Path(prefix, "share", "ament_index", "resource_index", "packages", PACKAGE)
        if prefix and index.is_file():
            candidates.append(Path(prefix, "share", PACKAGE))
    candidates += [parent / "share" / PACKAGE for parent in code.parents]
    for candidate in candidates:
        if (candidate / _MARKER).is_file():
            return candidate
    raise FileNotFoundError(
        f"the files installed with {PACKAGE} are neither beside its code in {code}, nor in the ament index, "
        f"nor in a share/{PACKAGE} folder of this environment; install the package again"
    )


def share_file(*parts: str) -> Path:
    """Path of one installed file, such as `share_file("config", "space_arm.yaml")`.

    Raises:
        FileNotFoundError: there is no such file; the sentence lists those of the same kind.
    """
    path = share_directory().joinpath(*parts)
    if not path.is_file():
        there = ", ".join(sorted(p.name for p in path.parent.glob("*"))) or "nothing"
        raise FileNotFoundError(f"{path} does not exist; in {path.parent} there is: {there}")
    return path


def package_file(uri: str) -> Path:
    """Path of `package://PACKAGE/FILE`, as URDFs and launch files have it, by the ament index.

    Raises:
        FileNotFoundError: no such package; the sentence says what to do.
    """
    package, _, file = uri.removeprefix("package://").partition("/")
    if package == PACKAGE:
        return share_directory() / file
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix and Path(prefix, "share", "ament_index", "resource_index", "packages", package).is_file():
            return Path(prefix, "share", package, file)
    raise FileNotFoundError(
        f"there is no package '{package}' in the ament index; source the workspace that has it "
        "(. install/setup.bash), or give the path of the file"
    )


def scene_path(name: str) -> Path:
    """Path of a scene; a bare name that is not in the working directory is sought among the installed ones.

    What is in neither place keeps its name, for whoever reads it to complain of.
    """
    path = Path(os.path.expanduser(name))
    if name and not os.path.exists(path) and path.name == name:
        with contextlib.suppress(FileNotFoundError):
            return share_file("config", name)
    return path
