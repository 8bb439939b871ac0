"""Identifiability of the parameters of a calibration from its data before the solve, with advice on better runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.offline.calibration.parameters import Parameter
from cable_twin.offline.calibration.prediction import Evaluation, Rows

TOLD = 0.5  # of the prior deviation, above which a parameter is not told
ALIKE = 0.8  # correlation from which on two parameters are told together only
ADVICE = (  # by the end of a key, or the error of a sensor: what has to happen in a run that tells it
    (r"friction|resistance", "a run at constant speed in both directions"),
    (r"damping", "a run with an emergency stop and half a minute of swing after it"),
    (r"\.payload\.|bodies\..*\.mass$", "a run that starts and stops, with a load cell or the force of the drive"),
    (r"mass_per_length$", "a run through all of the span with load cells at both ends or at a tower"),
    (r"(\.|_)stiffness$", "a run through all of the span with a load cell at a fixed end, and the drive's place"),
    (r"\.(start|end|counterweight)\.mass$", "a run with a load cell at the counterweight"),
    (r"drag|wind|density", "a run at high speed and one against it, or the same run in wind"),
    (r"temperature|ice", "a run long enough for a change of temperature or ice, with load cells"),
    (r"inertia", "a run that starts and stops"),
    (r"\.delay$", "a run with starts and stops, of which this sensor sees the moment"),
    (r"\.gain$", "a run in which what this sensor measures changes by more than a tenth"),
    (r"\.bias$", "a run in a state that is known otherwise, such as one without load"),
)
OTHERWISE = "a run in which this parameter matters more"


class Finding(NamedTuple):
    """Identifiability of one parameter: posterior standard deviations, relative to its prior standard deviation."""

    parameter: Parameter
    alone: float  # standard deviation with all others known
    together: float  # standard deviation with all others free
    partner: str  # parameter that it is told together with, or empty
    correlation: float  # with this one

    @property
    def told(self) -> bool:
        """Whether the data identify the parameter: its posterior standard deviation is at most half the prior one."""
        return self.together <= TOLD

    def reason(self, moved: bool) -> str:
        """Line about a parameter that the data do not identify: why, and which run would identify it."""
        key, run = self.parameter.key, advice(self.parameter)
        if self.alone > TOLD:
            seen = "no sensor feels it here" if self.alone > 0.999 else f"the data narrow its prior to {self.alone:.0%}"
            still = "" if moved else " (nothing was commanded)"
            return f"{key} cannot be told: {seen}{still}; {run} would tell it"
        return (
            f"{key} cannot be told apart from {self.partner} (correlation {self.correlation:.2f}): with that known it "
            f"could; {run} would tell it"
        )


class Check(NamedTuple):
    """Result of the identifiability check of a calibration: findings by parameter, and singular values."""

    findings: tuple[Finding, ...]
    singular_values: FloatArray  # of the Jacobian in deviations of sensors and priors, largest first

    @property
    def told(self) -> list[int]:
        """Indices of the parameters that the data identify."""
        return [number for number, one in enumerate(self.findings) if one.told]

    @property
    def rank(self) -> int:
        """Number of directions in parameter space about which the data say more than the priors."""
        return int((self.singular_values > 1.0).sum())


def advice(parameter: Parameter) -> str:
    """Advice on the run whose data would identify a parameter."""
    return next((run for pattern, run in ADVICE if re.search(pattern, parameter.key)), OTHERWISE)


def check(parameters: Sequence[Parameter], evaluation: Evaluation, rows: Rows) -> Check:
    """Check identifiability of all parameters: singular values of the scaled Jacobian, deviations, correlations."""
    jacobian = evaluation.jacobian[~rows.held]
    singular: FloatArray = np.linalg.svd(jacobian, compute_uv=False).astype(np.float64)
    covariance = covariance_of(jacobian)
    deviations = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviations, deviations)
    alone = 1.0 / np.sqrt(1.0 + (jacobian**2).sum(axis=0))
    findings = []
    for number, parameter in enumerate(parameters):
        others: FloatArray = np.abs(correlation[number]).astype(np.float64)
        others[number] = 0.0
        partner = int(others.argmax())
        name = parameters[partner].key if len(parameters) > 1 and others[partner] > 0.0 else ""
        findings.append(
            Finding(parameter, float(alone[number]), float(deviations[number]), name, correlation[number, partner])
        )
    return Check(tuple(findings), singular)


def covariance_of(jacobian: FloatArray) -> FloatArray:
    """Posterior covariance (n, n) of parameters, scaled by prior standard deviations, from a scaled Jacobian."""
    inverse = np.linalg.inv(jacobian.T @ jacobian + np.eye(jacobian.shape[1]))
    return np.asarray(inverse, dtype=np.float64)
