"""Translation of the texts of a report by their English form."""

from __future__ import annotations

import re
from collections.abc import Mapping

from cable_twin.key_figures import QUANTITIES, KeyFigure
from cable_twin.key_figures.quantities import ANY
from cable_twin.offline.reporting import german

LANGUAGES: Mapping[str, Mapping[str, str]] = {"en": {}, "de": german.TEXTS}


class Texts:
    """Translator of the texts of a report from English into a language.

    Args:
        language: one of `LANGUAGES`.
    """

    def __init__(self, language: str) -> None:
        self.language, self._table = language, LANGUAGES[language]
        self._names = german.QUANTITIES if language == "de" else {}
        self._phrases = german.PHRASES if language == "de" else {}
        self.missing: set[str] = set()  # texts that are shown in English for want of a translation

    def __call__(self, text: str) -> str:
        """Translate a text; returns the English text where the table lacks a translation."""
        if self.language == "en" or not text:
            return text
        if text not in self._table:
            self.missing.add(text)
        return self._table.get(text, text)

    def figure(self, figure: KeyFigure) -> str:
        """Printed name of a key figure in the language of the report."""
        if self.language == "en":
            return figure.name
        row = QUANTITIES[figure.id.quantity]
        pattern = re.escape(row.name).replace(re.escape("{}"), "(.*)")
        before, name = ("", figure.name) if ": " not in figure.name else figure.name.split(": ", 1)
        found = re.search(pattern, name)
        if row.quantity not in self._names or found is None:
            self.missing.add(figure.name)
            return figure.name
        detail = self._detail(found[1] if found.groups() else "")
        said = self._names[row.quantity].format(detail)
        said += f", {self(figure.id.statistic)}" if len(row.statistics) > 1 else ""
        before = re.sub(r"^haul rope of(?= )", lambda one: self(one[0]), before)
        return f"{before}: {said}" if before else said

    def _detail(self, text: str) -> str:
        """Translate the detail within the name of a key figure, such as the span of a sag."""
        for word in ("to", "start", "end", "its", "the"):
            text = re.sub(rf"(?<!\S){word}(?!\S)", self(word), text)
        return text

    def quantity(self, quantity: str) -> str:
        """Name of a quantity of key figures in the language of the report, without detail."""
        row = QUANTITIES[quantity]
        if self.language == "en" or quantity not in self._names:
            return row.in_general
        return self._names[quantity].format(self(ANY.get(quantity, "")))

    def phrase(self, text: str) -> str:
        """Translate known phrases in the place, source or way of sampling of a key figure."""
        text = f" {text}"  # of which each phrase may be the first one
        for english, own in self._phrases.items():
            text = text.replace(english, own)
        return text[1:]

    def limit(self, text: str) -> str:
        """Translate the comparison in the text of a limit, such as `at most 2.5 m/s`."""
        for comparison in ("at most", "at least", "below", "above", "within"):
            if text.startswith(comparison):
                return f"{self(comparison)}{text.removeprefix(comparison)}".replace(" to ", f" {self('to')} ")
        return text
