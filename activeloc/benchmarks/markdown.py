"""A report as a page's tables."""

from __future__ import annotations

from collections.abc import Iterator

from activeloc.benchmarks.report import Report, Row, Spread, Target

HEADINGS = ("", "ours", "10 ... 90 %", "yardstick", "theirs", "ratio", "target", "met")


def number(value: float) -> str:
    """Three figures, with commas in thousands."""
    if value == 0.0:
        return "0"
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def spread(values: Spread) -> str:
    """The middle four fifths; nothing of a single value."""
    return "" if values.n == 1 else f"{number(values.low)} ... {number(values.high)}"


def target(given: Target | None) -> str:
    """As in ``<= 0.55 x``, of the yardstick's, and ``<= 2``."""
    if given is None:
        return ""
    sign = "<=" if given.at == "most" else ">="
    return f"{sign} {number(given.limit)}{' x' if given.of == 'ratio' else ''}"


def cells(row: Row) -> tuple[str, ...]:
    """A row as text, under :data:`HEADINGS`."""
    return (
        f"{row.name} [{row.unit}]",
        number(row.ours.median),
        spread(row.ours),
        row.yardstick,
        "" if row.theirs is None else number(row.theirs.median),
        "" if row.ratio is None else f"{row.ratio:.2f} x",
        target(row.target),
        {None: "", True: "yes", False: "no"}[row.is_met],
    )


def machine_line(machine: dict[str, object]) -> str:
    """The machine in a sentence."""
    versions = machine["versions"]
    assert isinstance(versions, dict)
    given = ", ".join(f"{name} {version}" for name, version in versions.items())
    return (
        f"{machine['processor']}, {machine['processors']} processors, {machine['system']}; "
        f"Python {machine['python']}, {given}; load average {machine['load_average']} at the start"
    )


def tables(report: Report) -> Iterator[str]:
    """Lines of a table for each subject, notes under it."""
    yield f"{machine_line(report.machine)}."
    for subject in dict.fromkeys(row.subject for row in report.rows):
        rows = [row for row in report.rows if row.subject == subject]
        yield f"\n## {subject}\n"
        yield f"| {' | '.join(HEADINGS)} |"
        yield f"|{'---|' * len(HEADINGS)}"
        for row in rows:
            yield f"| {' | '.join(cells(row))} |"
        notes = dict.fromkeys(f"{row.name}: {row.note}." for row in rows if row.note)
        if notes:
            yield "\n" + " ".join(notes)
    for what in report.absent:
        yield f"\nNot measured: {what.subject}, {what.name}: {what.reason}."


def verdict(report: Report) -> str:
    """How many targets are met."""
    verdicts = [row.is_met for row in report.rows if row.is_met is not None]
    return f"{sum(verdicts)} of {len(verdicts)} targets met"


def to_markdown(report: Report, command: str) -> str:
    """The whole of it.

    Args:
        report: What was measured.
        command: With which it can be measured again.
    """
    lines = ["# What the parts cost", "", f"`{command}`: {verdict(report)}.", "", *tables(report)]
    return "\n".join(lines) + "\n"
