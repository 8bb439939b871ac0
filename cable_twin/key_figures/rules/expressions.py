"""Limits of rules as formulas: arithmetic of named variables, evaluated without running code from a file."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from math import exp, isfinite, log, sqrt, tan

OPERATORS: dict[type[ast.AST], Callable[..., float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
}
FUNCTIONS: dict[str, Callable[..., float]] = {
    "min": min, "max": max, "exp": exp, "log": log, "sqrt": sqrt, "tan": tan,
}  # fmt: skip
LONGEST = 200  # characters
ALLOWED = f"a number, or a formula with + - * /, {', '.join(FUNCTIONS)} and variables"


class FormulaError(ValueError):
    """Error of a formula that cannot be read or evaluated; one line."""


class MissingError(LookupError):
    """Error of a variable without a value in a formula or condition; its text is the name of the variable."""


def variables_of(formula: str) -> set[str]:
    """Names of the variables in the formula of a rule.

    Raises:
        FormulaError: the text is not a valid formula.
    """
    tree = _tree(formula)
    _check(tree)
    called = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)} - called


def value_of(formula: str | float, values: Mapping[str, float | None]) -> float:
    """Evaluate the limit of a rule: a number, or a formula of variables.

    Args:
        formula: number, or text with variables.
        values: number of each variable, None where it is not known.

    Raises:
        MissingError: a variable has no value.
        FormulaError: the formula cannot be evaluated, as in a division by 0.
    """
    if not isinstance(formula, str):
        return float(formula)
    try:
        value = _value(_tree(formula), values)
    except (ArithmeticError, ValueError) as error:
        raise FormulaError(f"{formula!r} has no value ({error})") from None
    if not isfinite(value):
        raise FormulaError(f"{formula!r} has no finite value")
    return value


def _tree(formula: str) -> ast.expr:
    if len(formula) > LONGEST:
        raise FormulaError(f"{len(formula)} characters; allowed: at most {LONGEST}")
    try:
        return ast.parse(formula, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise FormulaError(f"not a valid formula; allowed: {ALLOWED}") from None


def _check(node: ast.expr) -> None:
    """Refuse a formula with anything but numbers, variables, operators and known functions."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        _check(node.left)
        _check(node.right)
    elif isinstance(node, ast.UnaryOp) and type(node.op) in OPERATORS:
        _check(node.operand)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in FUNCTIONS and node.args:
        if node.keywords or len(node.args) > 2:
            raise FormulaError(f"not a valid formula; allowed: {ALLOWED}")
        for argument in node.args:
            _check(argument)
    elif not (isinstance(node, ast.Name) or (isinstance(node, ast.Constant) and type(node.value) in (int, float))):
        raise FormulaError(f"not a valid formula; allowed: {ALLOWED}")


def _value(node: ast.expr, values: Mapping[str, float | None]) -> float:
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)](_value(node.left, values), _value(node.right, values))
    if isinstance(node, ast.UnaryOp):
        return OPERATORS[type(node.op)](_value(node.operand, values))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return FUNCTIONS[node.func.id](*(_value(argument, values) for argument in node.args))
    if isinstance(node, ast.Name):
        found = values.get(node.id)
        if found is None:
            raise MissingError(node.id)
        return float(found)
    assert isinstance(node, ast.Constant)
    assert isinstance(node.value, int | float)
    return float(node.value)
