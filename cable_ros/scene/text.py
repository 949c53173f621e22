# SPDX-License-Identifier: Apache-2.0
"""YAML text to plain values, with every slip of the text as a sentence.

The values follow YAML 1.2: `6.70e6` and `1e-3` are numbers, `on` and `no` are words, and `010` is ten.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from cable_ros.common.regular_file import NotRegularFileError, open_regular
from cable_ros.scene.caps import DEEPEST_VALUE, MOST_MERGED, MOST_SCENE_CHARACTERS, MOST_VALUES
from cable_ros.scene.errors import SceneError

_TAGS = tuple(f"tag:yaml.org,2002:{kind}" for kind in ("null", "str", "seq", "map"))
_LONGEST_INTEGER = 4000  # digits; Python refuses somewhat longer ones, which are infinite to a float


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2 and without repeated keys, dates, sets and bytes."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012
    yaml_constructors = {  # noqa: RUF012
        tag: construct
        for tag, construct in yaml.SafeLoader.yaml_constructors.items()
        if tag in (*_TAGS, None)
    }

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        super().flatten_mapping(node)
        if len(node.value) > MOST_MERGED:
            raise yaml.constructor.ConstructorError(
                None, None, f"more than {MOST_MERGED} fields are in one mapping", node.start_mark
            )

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            if key.tag == "tag:yaml.org,2002:merge":
                continue
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a field name must be a single word", key.start_mark
                )
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the field '{key.value}' stands here twice; keep one", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _add_scalar(tag: str, pattern: str, first: str, construct: Any) -> None:
    tag = f"tag:yaml.org,2002:{tag}"

    def scalar(loader: _Loader, node: Any) -> Any:
        return construct(loader.construct_scalar(node))

    _Loader.add_implicit_resolver(tag, re.compile(pattern), list(first))
    _Loader.add_constructor(tag, scalar)


_add_scalar("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF", lambda text: text.lower() == "true")
_add_scalar("int", r"^[-+]?[0-9]+$", "-+0123456789", lambda text: _integer(text))
_add_scalar(
    "float",
    r"^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$",
    "-+.0123456789",
    lambda text: float(re.sub(r"\.(?=[iInN])", "", text)),
)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""]
)
_Loader.add_implicit_resolver("tag:yaml.org,2002:merge", re.compile(r"^<<$"), ["<"])


def _integer(text: str) -> int | float:
    return int(text) if len(text) <= _LONGEST_INTEGER else float(text)


def read_text(path: Path, source: str, what: str, most: int = MOST_SCENE_CHARACTERS) -> str:
    """The file's text, of at most `most` bytes; a SceneError names `source` and says `what` was expected."""
    try:
        with io.BufferedReader(open_regular(path)) as file:
            data = file.read(most + 1)
        if len(data) > most:
            raise SceneError(source, "", f"has more than {most} bytes; give the path of {what}")
        return data.decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError:
        raise SceneError(source, "", f"there is no such file; give the path of {what}") from None
    except IsADirectoryError:
        raise SceneError(source, "", f"this is a folder; give the path of {what}") from None
    except NotRegularFileError:
        raise SceneError(
            source, "", f"this is a device, a pipe or a socket; give the path of {what}, a regular file"
        ) from None
    except UnicodeDecodeError as error:
        raise SceneError(
            source, "", f"byte {error.start} is not UTF-8 text; give the path of {what}, saved as UTF-8"
        ) from None
    except OSError as error:
        raise SceneError(source, "", f"cannot be read ({error.strerror}); give the path of {what}") from None


def parse_yaml(text: str, source: str) -> Any:
    """Plain values of YAML text.

    Raises:
        SceneError: not YAML (with line and column), a field twice, nothing in it, or too much.
    """
    if len(text) > MOST_SCENE_CHARACTERS:
        raise SceneError(source, "", f"has more than {MOST_SCENE_CHARACTERS} characters; make it shorter")
    try:
        values = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise SceneError(source, place, f"{error.problem or error.context}") from None
    except RecursionError:
        raise SceneError(source, "", _TOO_DEEP) from None
    except (yaml.YAMLError, ValueError) as error:
        detail = " ".join(str(error).split())
        raise SceneError(source, "", f"this is not YAML ({detail}); see config/space_arm.yaml") from None
    if values is None:
        raise SceneError(source, "", "the file is empty; a scene needs 'gravity' and 'cables'")
    check_amount(values, source)
    return values


_TOO_DEEP = f"is nested more than {DEEPEST_VALUE} deep; a scene needs 7 levels"


def check_amount(values: Any, source: str) -> None:
    """Raise SceneError if there is more in `values` than a scene needs, also by aliases or in a ring."""
    count, waiting = 0, [(values, 0)]
    while waiting:
        value, depth = waiting.pop()
        if depth > DEEPEST_VALUE:
            raise SceneError(source, "", _TOO_DEEP)
        inner = value.values() if isinstance(value, Mapping) else value
        if isinstance(value, Mapping | list | tuple):
            count += len(value)
            if count > MOST_VALUES:
                raise SceneError(
                    source,
                    "",
                    f"holds more than {MOST_VALUES} values, its aliases written out; make it smaller",
                )
            waiting += [(entry, depth + 1) for entry in inner]
