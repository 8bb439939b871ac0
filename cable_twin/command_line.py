"""What all commands of the package share: options that answer in one line."""

from __future__ import annotations

import argparse
import re
import sys
from typing import NoReturn


class OneLineParser(argparse.ArgumentParser):
    """Says in one line what is wrong with an option, not below a screen of usage."""

    def __init__(self, prog: str, description: str, epilog: str, *, failure: int = 1) -> None:
        """Set up a parser without options.

        Args:
            prog: name of the command.
            description: what it does.
            epilog: examples and exit codes, shown as they are.
            failure: exit code for a wrong option.
        """
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self._failure = failure
        # argparse takes -2e5 for an option
        self._negative_number_matcher = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Print the line and end."""
        print(f"{self.prog}: {message}; all options: {self.prog} --help", file=sys.stderr)
        sys.exit(self._failure)
