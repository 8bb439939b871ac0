"""HTML page of a report, all sections in one self-contained file, and its PDF by WeasyPrint or headless Chromium."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING

from cable_twin.basics.units import with_unit
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections import SECTIONS
from cable_twin.offline.reporting.sections.figures import limits_summary
from cable_twin.offline.reporting.sections.rules import rules_summary
from cable_twin.offline.reporting.sections.section import Section
from cable_twin.offline.reporting.texts import Texts

if TYPE_CHECKING:
    from jinja2 import Environment


UNITS = {"m/s^2": "m/s²", "N/mm^2": "N/mm²", "kg/m^3": "kg/m³", "kg m^2": "kg m²"}  # as they are printed


def write_page(
    results: Results, texts: Texts, command: str, version: str, sections: Sequence[Section] = SECTIONS
) -> str:
    """HTML text of the page of a report, with all drawings and styles in it.

    Args:
        results: results to show.
        texts: texts in the language of the page.
        command: command that makes the report, with its options.
        version: of this package.
        sections: sections in their order.
    """
    environment = _environment(texts)
    parts = []
    for one in sections:
        content = one.content(results, texts)
        if content is not None:
            body = environment.get_template(one.template).render(**content, results=results)
            parts.append((anchor(one.title), texts(one.title), body))
    page = environment.get_template("page.html").render(
        results=results,
        parts=parts,
        language=texts.language,
        limits=limits_summary(results, texts),
        rules=rules_summary(results, texts),
        command=command,
        version=version,
        made=f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC",
    )
    for plain, raised in UNITS.items():
        page = page.replace(plain, raised)
    return re.sub(r"\n\s*\n+", "\n", page)


def anchor(title: str) -> str:
    """HTML anchor of a section of a report from its English title."""
    return re.sub(r"[^a-z]+", "_", title.lower()).strip("_")


def _environment(texts: Texts) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - an extra

    loader = PackageLoader("cable_twin.offline.reporting", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals |= {"t": texts, "with_unit": with_unit}
    return environment


BROWSERS = "chromium", "chromium-browser", "google-chrome", "chrome"
PATIENCE = 120.0  # s for a browser
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-pdf-header-footer",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)

Printer = Callable[[str, Path], None]


class PrintError(RuntimeError):
    """Failure to make the PDF of a report; the message is one line."""


def find_printer() -> Printer:
    """Find a printer: a function of HTML text and PDF path that writes the PDF; it raises PrintError and OSError.

    Raises:
        PrintError: neither WeasyPrint nor Chromium is installed.
    """
    try:
        from weasyprint import HTML  # noqa: PLC0415 - an extra
    except (ImportError, OSError) as error:  # OSError: its libraries of the system are not there
        reason = "WeasyPrint is not installed" if isinstance(error, ImportError) else "WeasyPrint finds no Pango"
        browser = next(filter(None, map(shutil.which, BROWSERS)), None)
        if browser is None:
            raise PrintError(f"{reason}, and there is no Chromium") from None
        return lambda page, file: _by_browser(browser, page, file)

    def print_it(page: str, file: Path) -> None:
        file.write_bytes(HTML(string=page).write_pdf())

    return print_it


def _by_browser(browser: str, page: str, file: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="cable_twin_report_") as directory:
        source, made = Path(directory) / "page.html", Path(directory) / "page.pdf"
        source.write_text(page, encoding="utf-8")
        command = [browser, *OPTIONS, f"--user-data-dir={directory}", f"--print-to-pdf={made}", f"file://{source}"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
        except subprocess.TimeoutExpired:
            raise PrintError(f"{browser} has not printed in {PATIENCE:g} s") from None
        if done.returncode or not made.exists():
            last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise PrintError(f"{browser} has not printed: {last}")
        shutil.copyfile(made, file)
