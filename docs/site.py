# SPDX-License-Identifier: Apache-2.0
"""What the site needs beyond MkDocs: files from outside this folder, and equations without a script.

MkDocs calls the functions here by their names, as mkdocs.yml says under `hooks`.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
OUTSIDE = re.compile(r"\]\(\.\./([^)#]+)")
"""A link to a file of the repository that is no page."""
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.S)
TAG = re.compile(r"\\tag\{(\w+)\}")


def on_files(files: Files, config: Any) -> Files:
    """Bring each file that a page links to along, as it is."""
    for page in files.documentation_pages():
        for name in OUTSIDE.findall(page.content_string):
            if files.get_file_from_path(_copied(name)) is None:
                files.append(File.generated(config, _copied(name), abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Point such links at the copies."""
    return OUTSIDE.sub(lambda found: f"]({_copied(found[1])}", markdown)


def _copied(name: str) -> str:
    return f"files/{name}" + (".txt" if name.endswith(".md") else "")


def on_page_content(content: str, **_: Any) -> str:
    """Equations as MathML, which browsers draw by themselves."""
    return EQUATION.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    latex = html.unescape(found[3])
    numbers = TAG.findall(latex)
    display = "inline" if found[2] == "(" else "block"
    # What latex2mathml does not know: numbers of equations, which stand beside, and two spacings.
    latex = TAG.sub("", latex).replace(r"\tfrac", r"\frac")
    number = f'<span class="number">({numbers[0]})</span>' if numbers else ""
    equation = convert(latex, display=display)
    return f'<div class="equation">{equation}{number}</div>' if display == "block" else equation
