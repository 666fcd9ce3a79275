"""Soft-tissue thickness of adults as the literature has it."""

from typing import NamedTuple


class Published(NamedTuple):
    """Adult mean and standard deviation, mm, and their source."""

    mean: float
    sd: float
    source: str


ORTHOGNATHIC = "[X] CT of 15 orthognathic patients"
PUBLISHED = {
    "glabella": Published(6.4, 1.1, ORTHOGNATHIC),
    "nasion": Published(7.8, 1.5, ORTHOGNATHIC),
    "subnasale": Published(15.6, 2.4, "[S: 10.1016/j.forsciint.2018.10.021]"),
    # 15.5 there, 13.5 to 14 in people of other studies [S], 11 in older tables [R]: a value between is taken.
    "mid_philtrum": Published(13.0, 2.4, "[X], [S], [R] disputed: 11 to 15.5"),
    "labrale_superius": Published(11.5, 2.2, "[R]"),
    "labrale_inferius": Published(13.0, 2.0, "[R]"),
    "mentolabial": Published(11.0, 2.0, "[R]"),
    "pogonion": Published(11.0, 2.3, "[R]"),
    "menton": Published(7.0, 2.0, "[R]"),
    "zygoma": Published(9.1, 1.9, ORTHOGNATHIC),
    "masseter": Published(18.0, 3.5, "[R]"),
    "cheek": Published(22.0, 4.0, "[R] 20 and more"),
}
