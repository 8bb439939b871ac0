"""CSV files as spreadsheets write them: columns between commas, semicolons or tabulators, decimal commas with these."""

from __future__ import annotations

COMMA = ","


def separator_of(header: str) -> str:
    """Mark between the columns of a CSV file, from its header: `;`, a tabulator, else a comma."""
    return next((mark for mark in (";", "\t") if mark in header), COMMA)


def with_point(cell: str, separator: str) -> str:
    """Cell of a CSV file with a decimal point for a decimal comma, which there is where no comma separates columns."""
    return cell if separator == COMMA else cell.replace(COMMA, ".")
