"""Conversion of key figures to diagnostic statuses and back, for topics and bags; statuses of outlooks, estimates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from cable_twin.basics.printable import printable
from cable_twin.basics.units import counted, rounded, shown_unit
from cable_twin.key_figures import KeyFigure, figure_from_values, values_of
from cable_twin.key_figures.outlook import Outlook
from cable_twin.key_figures.shown import digits_of, shown
from cable_twin.messages import Status, diagnostics_message, statuses_of_message

OK, WARNING = 0, 1  # levels of diagnostics
LONGEST_TEXT = 1000  # characters of what a bag says of a figure
OF_PAYLOAD = "_of_payload"  # end of the key of an alarm about a payload
OLD = 0.25  # of its horizon, from which on an outlook is too old to warn in time


def figure_statuses(figures: Iterable[KeyFigure]) -> list[Status]:
    """Diagnostic status of each key figure: a warning where a limit is not kept."""
    return [
        Status(WARNING if figure.kept is False else OK, figure.name, describe(figure), values_of(figure))
        for figure in figures
    ]


def figures_message(figures: Iterable[KeyFigure], stamp_ns: int) -> bytes:
    """Encode key figures as a diagnostic_msgs/DiagnosticArray with a stamp in ns."""
    return diagnostics_message(stamp_ns, *figure_statuses(figures))


def outlook_statuses(outlook: Outlook, age: float) -> list[Status]:
    """Diagnostic statuses of an outlook: a summary, then each key figure of each forecast; a warning beyond its limit.

    Args:
        outlook: outlook of a twin.
        age: s by the clock since the capture of the state from which the outlook was computed.
    """
    warnings = outlook.warnings
    values = {
        "time_s": repr(outlook.time),
        "horizon_s": repr(outlook.horizon),
        "age_s": f"{age:.3f}",
        "took_s": f"{outlook.effort:.3f}",
    }
    values |= {one.name: one.fault or one.assumed for one in outlook.futures}
    count = counted(len(warnings), "limit")
    whole = f"{count} would be passed" if warnings else "no limit would be passed"
    old = age > OLD * outlook.horizon
    whole += f"; {age:.0f} s old, of a horizon of {outlook.horizon:g} s" if old else ""
    found = [Status(WARNING if warnings or old else OK, "outlook", whole, values)]
    for future in outlook.futures:
        for one in future.figures:
            passed = {"passed_s": repr(float(future.passed[one.id]))} if one.id in future.passed else {}
            text = future.warning(one).removeprefix(f"{future.name}: ") if passed else describe(one)
            own = {"future": future.name, **values_of(one), **passed}
            found.append(Status(WARNING if passed else OK, f"{future.name}: {one.name}", text, own))
    return found


def estimate_message(
    estimates: Mapping[str, tuple[float, float, str]],
    alarms: Sequence[str],
    stamp_ns: int,
    *,
    of_payloads: Sequence[str] = (),
    measured: bool = True,
    behind: float = 0.0,
) -> bytes:
    """Encode estimates as a diagnostic_msgs/DiagnosticArray: a status with new alarms, then one of each estimate.

    Args:
        estimates: value, standard deviation and unit by name.
        alarms: new alarms, a line each.
        of_payloads: new alarms about payloads, of which a lift has many; behind the others, with keys of their own.
        stamp_ns: ns.
        measured: whether a plant is measured at present; else they are those of the model alone.
        behind: s, by which the estimates are behind the plant.
    """
    told = {f"alarm_{row}": text for row, text in enumerate(alarms, start=1)}
    told |= {f"alarm_{row}{OF_PAYLOAD}": text for row, text in enumerate(of_payloads, start=1 + len(alarms))}
    whole = Status(
        WARNING if told else OK,
        "estimate",
        counted(len(told), "alarm") if told else "no new alarm",
        {"measured": str(measured).lower(), "behind_s": f"{behind:.1f}"} | told,
    )
    each = [
        Status(
            OK,
            name,
            f"{value:.6g} {unit}, standard deviation {deviation:.3g}",
            {"value": repr(value), "standard_deviation": repr(deviation), "unit": unit},
        )
        for name, (value, deviation, unit) in estimates.items()
    ]
    return diagnostics_message(stamp_ns, whole, *each)


def estimates_of_message(data: bytes) -> dict[str, tuple[float, float, str]]:
    """Value, standard deviation and unit of each estimate by name, inverse of `estimate_message`."""
    return {
        status.name: (float(values["value"]), float(values["standard_deviation"]), values["unit"])
        for status in statuses_of_message(data)
        if "standard_deviation" in (values := status.values)
    }


def figures_of_statuses(statuses: Sequence[Status]) -> list[KeyFigure]:
    """Key figures from their statuses, exact inverse of `figure_statuses`.

    Raises:
        ValueError: A status is not of a key figure.
    """
    return [
        figure_from_values(
            printable(status.name, LONGEST_TEXT),
            {key: printable(text, LONGEST_TEXT) for key, text in status.values.items()},
        )
        for status in statuses
    ]


def describe(figure: KeyFigure) -> str:
    """Text of a key figure: value, time and place, with its limit if any."""
    sizes = [abs(value) for value in (figure.value, figure.limit) if value is not None]
    unit, scale = shown_unit(figure.unit, max(sizes))
    unit, digits = "" if unit == "-" else f" {unit}", digits_of(figure, scale)
    parts = [f"{shown(figure.value, scale, digits)}{unit} at {figure.time:.2f} s"]
    if figure.place:
        parts.append(figure.place)
    if figure.limit is not None:
        parts.append(f"allowed: {figure.bound} {rounded(figure.limit * scale, digits)}{unit} ({figure.source})")
    return ", ".join(parts)
