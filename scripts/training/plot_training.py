"""Makes the picture of a fold's training of its loss histories."""

from pinnochio.columns import read_csv
from pinnochio.figures.training import COLUMNS, training_picture
from pinnochio.logs import attach_log


def plot_training(pretraining: str | None, finetuning: str, title: str, picture: str) -> None:
    """Draw the loss histories of the phases, CSV as the training writes them; the first may not have been."""
    histories = {"pretraining": pretraining, "adaptation": finetuning}
    read = {phase: read_csv(path, usecols=COLUMNS, dtype=float) for phase, path in histories.items() if path}
    training_picture(read, title, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    plot_training(
        pretraining=snakemake.input.get("pretraining") or None,
        finetuning=snakemake.input.finetuning,
        title=snakemake.params.title,
        picture=snakemake.output.picture,
    )
