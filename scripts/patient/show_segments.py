"""Draws the bone segments of an imported patient: where the cuts lie, the landmarks, what was repaired."""

from pinnochio.figures.segments import segments_picture
from pinnochio.json_text import read_stored_json
from pinnochio.logs import attach_log
from pinnochio.model.surfaces import BoneSurface, read_surface


def show_segments(bone: str, skin: str, report: str, picture: str) -> None:
    """Render bone and skin; report is the import's."""
    segments_picture(BoneSurface.read(bone), read_surface(skin), read_stored_json(report), picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    show_segments(**dict(snakemake.input.items()), picture=snakemake.output.picture)
