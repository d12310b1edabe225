"""What the site adds to Zensical: equations as MathML, docstrings as Markdown.

Equations are written in LaTeX in fences named ``math``, which GitHub draws by itself. Here they
become MathML while the site is built, so that a page needs no script and fetches nothing.
"""

from __future__ import annotations

import re
from typing import Any

import griffe
from latex2mathml.converter import convert

RULE = re.compile(r" *=+ +=+ *")
TABLE = re.compile(r"(?m)^ *=+ +=+ *\n(?:.*\S.*\n)+? *=+ +=+ *$(?!\n *\S)")
CODE_OR_BRACKET = re.compile(r"(?s)(```.*?```|``.*?``|`[^`]*`)|\[")
SESSION = re.compile(r"(?m)^( *)>>> (?:.*\S.*(?:\n|$))+")


def math_fence(source: str, language: str, css_class: str, *_: Any, **__: Any) -> str:
    r"""A fence's LaTeX as MathML; ``\qquad`` begins a new line."""
    lines = (convert(line, display="block") for line in source.split("\\qquad"))
    return f'<div class="{css_class}">{"".join(lines)}</div>'


def markdown_of(docstring: str) -> str:
    """A docstring's reStructuredText as Markdown: simple tables of two columns, sessions, roles."""
    text = TABLE.sub(lambda found: _table(found[0]), docstring)
    text = SESSION.sub(
        lambda found: f"{found[1]}```pycon\n{found[0].rstrip()}\n{found[1]}```\n", text
    )
    text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text)
    # Brackets are units, no links.
    return CODE_OR_BRACKET.sub(lambda found: found[1] or "\\[", text)


def _table(block: str) -> str:
    """Rules say where the second column begins; rows without a first cell go on with the last."""
    lines = block.splitlines()
    rule = lines[0]
    indent, second = len(rule) - len(rule.lstrip()), rule.rindex(" ") + 1
    rules = [i for i, line in enumerate(lines) if RULE.fullmatch(line)]
    rows: list[list[str]] = [] if len(rules) == 3 else [["", ""]]
    for line in lines:
        first, rest = line[indent:second].strip(), line[second:].strip()
        if RULE.fullmatch(line):
            continue
        if first:
            rows.append([first, rest])
        else:
            rows[-1][1] += " " + rest
    written = [" " * indent + "| " + " | ".join(row).replace("\n", " ") + " |" for row in rows]
    return "\n".join([written[0], " " * indent + "|---|---|", *written[1:]])


class Markdown(griffe.Extension):
    """Docstrings are read as Markdown."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """An object has been loaded."""
        if obj.docstring is not None:
            obj.docstring.value = markdown_of(obj.docstring.value)
