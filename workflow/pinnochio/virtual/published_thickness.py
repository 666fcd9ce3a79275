"""Soft-tissue thickness of adults as the literature has it."""

from typing import NamedTuple


class Published(NamedTuple):
    """Adult mean and standard deviation, mm, and their source."""

    mean: float
    sd: float
    source: str


PUBLISHED = {
    "glabella": Published(5.5, 1.2, "[R]"),
    "nasion": Published(6.5, 1.3, "[R]"),
    "subnasale": Published(15.6, 2.4, "[S: 10.1016/j.forsciint.2018.10.021]"),
    "mid_philtrum": Published(11.0, 2.0, "[R]"),
    "labrale_superius": Published(11.5, 2.2, "[R]"),
    "labrale_inferius": Published(13.0, 2.0, "[R]"),
    "mentolabial": Published(11.0, 2.0, "[R]"),
    "pogonion": Published(11.0, 2.3, "[R]"),
    "menton": Published(7.0, 2.0, "[R]"),
    "zygoma": Published(8.0, 2.0, "[R]"),
    "masseter": Published(18.0, 3.5, "[R]"),
    "cheek": Published(22.0, 4.0, "[R] 20 and more"),
}
