"""Marks that are drawn into a picture, in the world frame."""

from typing import NamedTuple

from quad_env.columns import Array, Vector

Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, 0 … 1."""


class Arrow(NamedTuple):
    """From a point to another, (3) m each; where they are the same nothing is drawn."""

    start: Vector[float]
    end: Vector[float]
    radius: float
    """Of the shaft, m."""
    colour: Colour


class Ball(NamedTuple):
    """About a point, (3), m."""

    centre: Vector[float]
    radius: float
    """m"""
    colour: Colour


class Ghost(NamedTuple):
    """The robot once more, in its home pose and one colour."""

    position: Vector[float]
    """Trunk centre, (3), m."""
    rotation: Array
    """From the base frame to the world frame, (3, 3)."""
    colour: Colour


Mark = Arrow | Ball | Ghost
