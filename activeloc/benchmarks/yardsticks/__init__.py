"""What the parts are held against: the plain way to do it, and other projects' code.

Those of other projects are used where they are installed (``pip install "activeloc[bench]"``); a
row says so where one is not.
"""

from __future__ import annotations

from importlib.util import find_spec


def is_installed(package: str) -> bool:
    """Whether a package can be imported."""
    return find_spec(package) is not None


def named(name: str, package: str) -> str:
    """A yardstick's name, as rows say it."""
    return name if is_installed(package) else f"{name} (not installed)"
