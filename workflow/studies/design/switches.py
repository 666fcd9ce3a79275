"""The networks of the design study: its base with one switch changed."""

from collections.abc import Mapping

from pinnochio.errors import InputError
from pinnochio.networks.settings import NetworkSettings
from pinnochio.overlays import overlaid


def switched(design: Mapping, networks: Mapping[str, Mapping]) -> dict[str, dict]:
    """Settings of each network by its name, design_{switch}: overlays of the one of `networks` that is the base.

    InputError where one cannot be built.
    """
    settings = {
        f"design_{name}": overlaid(networks[design["base"]], changes) for name, changes in design["switches"].items()
    }
    for name, values in settings.items():
        try:
            NetworkSettings(**values["network"])
        except ValueError as error:
            remedy = "change its keys in 'design.switches'"
            raise InputError(
                "-", "configuration", f"the network of {name!r} cannot be built: {error}", remedy
            ) from error
    return settings
