"""YAML text to plain values, with every slip of the text as a sentence.

The values follow YAML 1.2: `6.70e6` and `1e-3` are numbers, `on` and `no` are words, and `010` is ten.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from cable_ros.scene.errors import SceneError


class _Loader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2 and without repeated keys."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
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
    _Loader.add_implicit_resolver(tag, re.compile(pattern), list(first))
    if construct is not None:
        _Loader.add_constructor(tag, lambda loader, node: construct(node.value))


_add_scalar("bool", r"^(?:true|True|TRUE|false|False|FALSE)$", "tTfF", lambda text: text.lower() == "true")
_add_scalar("int", r"^[-+]?[0-9]+$", "-+0123456789", int)
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


def read_text(path: Path, source: str, what: str) -> str:
    """The file's text; a SceneError names `source` and says `what` was expected there."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise SceneError(source, "", f"there is no such file; give the path of {what}") from None
    except IsADirectoryError:
        raise SceneError(source, "", f"this is a folder; give the path of {what}") from None
    except UnicodeDecodeError as error:
        raise SceneError(
            source, "", f"byte {error.start} is not UTF-8 text; give the path of {what}, saved as UTF-8"
        ) from None
    except OSError as error:
        raise SceneError(source, "", f"cannot be read ({error.strerror}); give the path of {what}") from None


def parse_yaml(text: str, source: str) -> Any:
    """Plain values of YAML text.

    Raises:
        SceneError: not YAML (with line and column), a field twice, or nothing in it.
    """
    try:
        values = yaml.load(text, Loader=_Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise SceneError(source, place, f"{error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        detail = " ".join(str(error).split())
        raise SceneError(source, "", f"this is not YAML ({detail}); see config/space_arm.yaml") from None
    if values is None:
        raise SceneError(source, "", "the file is empty; a scene needs 'gravity' and 'cables'")
    return values
