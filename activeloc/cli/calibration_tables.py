"""The tables that ``activeloc calibrate`` prints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from activeloc.calibration import Report
    from activeloc.calibration.scores import Share


def calibration_tables(report: Report) -> list[tuple[str, Table]]:
    """Each table under its title."""
    tables = [
        ("rank of the truth in the posterior", _ranks(report)),
        ("truth in the set of highest probability", _shares("of the belief", report.coverage)),
        (
            "wrong declarations, made when first so sure",
            _shares("threshold", report.declarations),
        ),
    ]
    if report.nees:
        tables.append(
            (f"NEES of {report.tracks} runs from a known start; 3 is right", _nees(report))
        )
    return tables


def _table(*heads: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for i, head in enumerate(heads):
        table.add_column(head, justify="right" if i else "left", no_wrap=True)
    return table


def _ranks(report: Report) -> Table:
    table = _table("quantity", "mean", "p, chi-square", "p, KS")
    for name, one in report.ranks.items():
        table.add_row(name, f"{one.mean:.3f}", f"{one.chi2_p:.2g}", f"{one.ks_p:.2g}")
    return table


def _shares(head: str, shares: Mapping[float, Share]) -> Table:
    table = _table(head, "promised", "share", "95 % interval", "runs")
    for level, share in shares.items():
        if share.n == 0:
            table.add_row(f"{level:g}", "-", "-", "-", "0")
            continue
        low, high = share.interval
        table.add_row(
            f"{level:g}",
            f"{share.promised:.3f}",
            f"{share.value:.3f}",
            f"{low:.3f}..{high:.3f}",
            str(share.n),
        )
    return table


def _nees(report: Report) -> Table:
    table = _table("step", "mean", "99.9 %, Gaussian", "by the belief", "")
    for step, one in enumerate(report.nees):
        too = "" if one.holds else ("too sure" if one.mean > 3.0 else "too wide")
        table.add_row(
            str(step),
            f"{one.mean:.2f}",
            f"{one.low:.2f}..{one.high:.2f}",
            f"{3.0 - one.reach:.2f}..{3.0 + one.reach:.2f}",
            too,
        )
    return table
