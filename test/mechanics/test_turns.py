"""Rotations and orientations in space, against scipy's rotations and by differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from systems import difference

from cable_twin.mechanics.language.rotations import (
    by_turn,
    cross,
    grow_turn,
    gyration,
    inertia_of,
    inverse_of,
    moment,
    moment_by_turn,
    orientation,
    orientation_in_space,
    turn_between,
    turn_row,
)

SPACE = (0.0, 0.0, -9.81)
TENSOR = np.array([[0.5, 0.03, -0.02], [0.03, 0.4, 0.01], [-0.02, 0.01, 0.3]])


def body(turn):
    """Coordinates (7,) of a body rotated from upright by a rotation vector."""
    return np.array([0.3, -0.2, 0.5, *Rotation.from_rotvec(turn).as_quat()])


def matrix(row):
    return np.array(orientation(row, SPACE)).reshape(3, 3)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.0), (0.4, -1.2, 2.0), (1e-6, 2e-6, -1e-6)])
def test_orientation_is_that_of_its_quaternion(turn):
    row = body(np.array([0.3, -0.4, 1.0]))
    np.testing.assert_allclose(matrix(row), Rotation.from_quat(row[3:]).as_matrix(), atol=1e-15)
    exact = Rotation.from_rotvec(turn).as_matrix() @ matrix(row)
    turn_row(row, turn)
    np.testing.assert_allclose(matrix(row), exact, atol=1e-15)


@pytest.mark.parametrize("turn", [(0.02, -0.03, 0.01), (1e-7, 0.0, 2e-7), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("turned", [(0.1, 0.2, -0.15), (0.0, 0.0, 0.0)])
def test_a_rotation_vector_grows_by_what_the_product_of_the_turns_has_more(turned, turn):
    grown = np.array(turned)
    more = grow_turn(grown, turn)
    exact = (Rotation.from_rotvec(turn) * Rotation.from_rotvec(turned)).as_rotvec()
    np.testing.assert_allclose(grown, exact, atol=1e-15)
    np.testing.assert_allclose(more, exact - turned, atol=1e-15)


def test_products_of_arms():
    a, f, turn = np.array([0.3, -0.7, 0.2]), np.array([5.0, 2.0, -3.0]), np.array([0.2, 0.1, -0.4])
    np.testing.assert_allclose(cross(tuple(turn), tuple(a)), np.cross(turn, a), atol=1e-15)
    np.testing.assert_allclose(moment(tuple(a), tuple(f)), np.cross(a, f), atol=1e-15)
    np.testing.assert_allclose(np.reshape(by_turn(tuple(a)), (3, 3)) @ turn, np.cross(turn, a), atol=1e-15)
    np.testing.assert_allclose(np.reshape(by_turn(tuple(a)), (3, 3)).T @ f, np.cross(a, f), atol=1e-15)
    exact = np.cross(np.cross(turn, a), f)
    np.testing.assert_allclose(np.reshape(moment_by_turn(tuple(a), tuple(f)), (3, 3)) @ turn, exact, atol=1e-15)
    square = np.arange(9.0).reshape(3, 3) + 2.0 * np.eye(3)
    np.testing.assert_allclose(inverse_of(tuple(map(tuple, square))), np.linalg.inv(square), atol=1e-14)


def test_moment_of_a_turning_body_and_its_tangent():
    """J ω_dot + ω x J ω about the axes of the world, and its derivative by a rotation: to 2e-6."""
    row, turned = body(np.array([0.5, -0.8, 0.3])), np.array([0.02, 0.05, -0.03])
    spin, acceleration = np.array([1.2, -0.7, 0.9]), np.array([0.4, 2.0, -1.1])
    mass_factor, rate_factor = 40.0, 7.0

    def law(turn):
        """Moment after a rotation θ: Δ grows to log(exp θ exp Δ), with its rates and the body."""
        rotation = Rotation.from_rotvec(turn)
        grown = (rotation * Rotation.from_rotvec(turned)).as_rotvec() - turned
        axes = rotation.as_matrix() @ matrix(row)
        inertia = axes @ TENSOR @ axes.T
        omega = spin + rate_factor * grown
        return inertia @ (acceleration + mass_factor * grown) + np.cross(omega, inertia @ omega)

    inertia = inertia_of(TENSOR.reshape(1, 9), 0, orientation(row, SPACE), SPACE)
    total, by_turn_of_body = gyration(
        inertia, tuple(spin), tuple(acceleration), tuple(turned), mass_factor, rate_factor, 1.0
    )
    np.testing.assert_allclose(total, law(np.zeros(3)), atol=1e-14)
    exact = difference(law, np.zeros(3), 1e-3)
    np.testing.assert_allclose(np.reshape(by_turn_of_body, (3, 3)), exact, atol=2e-6 * np.abs(exact).max())


def test_roll_pitch_and_yaw():
    """About z, then about the body's own y, then about its own x."""
    row = np.array([0.0, 0.0, 0.0, *Rotation.from_euler("ZYX", [0.7, -0.3, 0.2]).as_quat()])
    quaternion, angles = orientation_in_space(row, SPACE)
    np.testing.assert_allclose(quaternion, row[3:], atol=0)
    np.testing.assert_allclose(angles, [0.2, -0.3, 0.7], atol=1e-15)


@pytest.mark.parametrize("turn", [(0.3, -0.2, 0.4), (1e-6, 0.0, -2e-6), (0.0, 0.0, 0.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_turn_between_two_orientations(turn, sign):
    first = body(np.array([0.5, -0.8, 0.3]))
    last = first.copy()
    turn_row(last, turn)
    last[3:] *= sign
    np.testing.assert_allclose(turn_between(first, last, SPACE), turn, atol=1e-15)
