"""Numba where it is installed; without it the same loops run as plain Python, slower, to the same result."""

try:
    from numba import njit
except ImportError:

    def njit(**_options):
        """A decorator that leaves the function as it is."""
        return lambda function: function


COMPILED = njit.__module__ != __name__
