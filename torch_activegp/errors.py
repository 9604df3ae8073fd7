"""Errors that speak to the user: what was wanted, what was found, what to do."""

from __future__ import annotations


class ActiveGPError(Exception):
    """Base of every error that this package raises on purpose.

    The command line turns it into one message and exit code 2.
    """


class ShapeError(ActiveGPError, ValueError):
    """A tensor has a shape that does not fit."""


class ConfigurationError(ActiveGPError, ValueError):
    """Arguments that contradict each other, or a value outside its range."""


class SimulationError(ActiveGPError, RuntimeError):
    """A simulator returned something that is not a state: NaN, infinity, a wrong shape."""


class DataError(ActiveGPError, ValueError):
    """A recording or data set that cannot be used as it is."""


class CheckpointError(ActiveGPError, RuntimeError):
    """A checkpoint that is missing, damaged, or was made by other settings."""


class PlanningError(ActiveGPError, RuntimeError):
    """A plan that cannot be made, for example because no candidate has a finite return."""
