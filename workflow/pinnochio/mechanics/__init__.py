"""Nearly incompressible hyperelasticity on tetrahedra. The one door: :func:`simulate`, :class:`Simulator`."""

from importlib import import_module


def __getattr__(name: str) -> object:
    """The door, loaded when it is asked for: the settings, which many modules read, are light."""
    if name in ("Simulator", "simulate"):
        return getattr(import_module(".simulation", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
