"""Draws the bone segments of an imported patient: where the cuts lie, the landmarks, what was repaired."""

import json
from pathlib import Path

from pinnochio.figures.segments import segments_picture
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import BoneSurface, read_surface


def show_segments(bone: str, skin: str, report: str, picture: str) -> None:
    """Render bone and skin; report is the import's."""
    said = json.loads(Path(report).read_text(encoding="utf-8"))
    segments_picture(BoneSurface.read(bone), read_surface(skin), said, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_segments(
        bone=snakemake.input.bone,
        skin=snakemake.input.skin,
        report=snakemake.input.report,
        picture=snakemake.output.picture,
    )
