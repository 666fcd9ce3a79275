"""Makes the picture of a fold's training of its loss histories."""

import pandas as pd

from pinnochio.evaluation.training_picture import training_picture
from pinnochio.logs import attach_log


def plot_training(pretraining: str, finetuning: str, title: str, picture: str) -> None:
    """Draw the loss histories of both phases, CSV as the training writes them."""
    training_picture({"pretraining": pd.read_csv(pretraining), "adaptation": pd.read_csv(finetuning)}, title, picture)


if __name__ == "__main__":
    attach_log(snakemake.log[0])
    plot_training(
        snakemake.input.pretraining, snakemake.input.finetuning, snakemake.params.title, snakemake.output.picture
    )
