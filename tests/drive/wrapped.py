"""A simulated robot inside another, made in whichever process holds it."""

from functools import partial


def wrapped(maker, around, *arguments):
    """A maker of `around(robot, *arguments)`, where `maker` makes the robot. Can be pickled."""
    return partial(_made, maker, around, arguments)


def _made(maker, around, arguments):
    return around(maker(), *arguments)
