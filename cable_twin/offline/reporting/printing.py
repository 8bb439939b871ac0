"""PDF of the page of a report: by WeasyPrint where installed, else by headless Chromium."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

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
