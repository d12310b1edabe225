"""Gather what the site is built from: ``python docs/site/assemble.py FOLDER``.

The pages of ``docs/``, the changelog, the contributor's page, the cards of the policies and the
examples, in one folder. Links between them are those of the repository and are turned to where the
files lie here; one that leads to a file that is not part of the site is an error.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
LINK = re.compile(r"(\]\(|src=\")(?!https?:|#|mailto:)([^)#\"\s]+)")


def places() -> dict[Path, Path]:
    """Where each file of the repository lies in the site, both relative."""
    found = {
        path.relative_to(ROOT): path.relative_to(ROOT / "docs")
        for path in sorted((ROOT / "docs").rglob("*"))
        if path.suffix in (".md", ".png", ".gif", ".css") and path.parent != HERE
    }
    found[Path("CHANGELOG.md")] = Path("changelog.md")
    found[Path("CONTRIBUTING.md")] = Path("contributing.md")
    for card in sorted((ROOT / "agents" / "policies").glob("*.md")):
        found[card.relative_to(ROOT)] = Path("policies") / card.name
    found[Path("examples")] = Path("examples.md")
    return found


def relinked(text: str, page: Path, found: dict[Path, Path]) -> str:
    """A page's text, its links turned to where the files lie in the site."""

    def turn(link: re.Match[str]) -> str:
        target = Path(os.path.normpath(page.parent / link[2]))
        if target not in found:
            raise SystemExit(f"{page}: {link[2]} is not part of the site")
        return link[1] + os.path.relpath(found[target], found[page].parent)

    return LINK.sub(turn, text)


def examples() -> str:
    """The examples as a page."""
    parts = ["# Examples\n\nEach is a file of `examples/` that runs as it is, in seconds.\n"]
    for path in sorted((ROOT / "examples").glob("*.py")):
        code = path.read_text("utf-8")
        title = code.split('"""')[1].split(":")[0]
        parts.append(f"## {title}\n\n`examples/{path.name}`\n\n```python\n{code.rstrip()}\n```\n")
    return "\n".join(parts)


def main(folder: Path) -> None:
    """Fill the folder anew."""
    shutil.rmtree(folder, ignore_errors=True)
    found = places()
    for source, target in found.items():
        path = folder / target
        path.parent.mkdir(parents=True, exist_ok=True)
        if source == Path("examples"):
            path.write_text(examples(), "utf-8")
        elif source.suffix == ".md":
            path.write_text(relinked((ROOT / source).read_text("utf-8"), source, found), "utf-8")
        else:
            shutil.copyfile(ROOT / source, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
