"""More patients than memory holds: each is shown as often, few are there at once, and nothing else changes."""

import gc
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.training.case_files import count_samples, read_fem_samples
from pinnochio.training.streaming import StreamedSamples
from tests.helpers.training import PHASES, TRAINING, make_cases, run


class Read:
    """A sample that says of which case it is, and remembers how many are alive."""

    alive = weakref.WeakSet()

    def __init__(self, case):
        self.case = case
        Read.alive.add(self)


@pytest.fixture
def cases():
    return [SimpleNamespace(case=number, fem_samples=None) for number in range(23)]


def test_an_epoch_shows_every_patient_once_and_holds_few(cases):
    samples = StreamedSamples(lambda files: [Read(files.case)], cases, 6)
    orders = [samples.order(np.random.default_rng(seed)) for seed in (0, 1)]
    assert sorted(orders[0]) == sorted(orders[1]) == list(range(23)) and list(orders[0]) != list(orders[1])
    for seed in (0, 1):
        order, most = samples.order(np.random.default_rng(seed)), 0
        for index in order:
            samples.order(np.random.default_rng(seed))  # asked for at every step
            assert samples[index].case == index
            gc.collect()
            most = max(most, len(Read.alive))
        assert 3 <= most <= 6


def test_samples_of_a_patient_are_counted_as_they_are_read(tmp_path):
    (files,) = make_cases(tmp_path, 1)
    assert count_samples(files) == len(read_fem_samples(files.fem_samples, "P")) == 1
    assert count_samples(replace(files, fem_samples=None)) == 1


def test_what_is_wrong_with_a_patient_is_said_where_it_is_shown(cases):
    def read(files):
        raise InputError(files.case, "model.h5", "is broken", "make it again")

    samples = StreamedSamples(read, cases, 4)
    with pytest.raises(InputError, match="is broken"):
        samples[int(samples.order(np.random.default_rng(0))[0])]


@pytest.mark.parametrize("phase", PHASES)
def test_a_training_that_streams_has_the_losses_of_one_that_does_not(phase, tmp_path):
    """A sample of each patient and blocks of one patient: the order of the samples is that of a list."""
    cases, histories = make_cases(tmp_path, 6), []
    for name, training in (("streamed", replace(TRAINING, patients_in_memory=2)), ("whole", TRAINING)):
        folder = tmp_path / name
        folder.mkdir()
        if phase == "finetune":
            run("pretrain", cases, folder)
        run(phase, cases, folder, training)
        histories.append((folder / PHASES[phase][1]).read_bytes())
    assert histories[0] == histories[1]
