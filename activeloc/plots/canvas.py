"""What all figures share: colours, and how they become files."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from activeloc.files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OKABE_ITO = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours that stay apart for every kind of colour vision (Okabe & Ito, 2008)."""


def save(figure: Figure, path: Path) -> None:
    """Encode in memory, write beside the target, and put it in its place in one step."""
    encoded = BytesIO()
    figure.savefig(encoded, format="png", dpi=150)
    write_atomically(path, encoded.getvalue())
