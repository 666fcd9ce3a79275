"""Time per stage and training budget, from a few files made by hand."""

import numpy as np
import pytest
import torch

from pinnochio.columns import read_table
from pinnochio.tables.stages import STAGES, read_benchmark, stages, tabulate
from pinnochio.tables.training import TRAINING, budget, parameters, table
from pinnochio.training.loop import COLUMNS
from tests.helpers.rows import benchmark
from tests.helpers.tables import write


@pytest.fixture
def benchmarks(tmp_path):
    folder = tmp_path / "benchmarks"
    for fold, seconds in (("1", 10), ("2", 30)):
        benchmark(folder / f"pretrain/{fold}_net.tsv", seconds, 1.5 * seconds, 500 + seconds)
    benchmark(folder / "finetune/1_net.tsv", 5, 4, 900)
    benchmark(folder / "report/V01.tsv", 0.04, "NA", "NA")
    benchmark(folder / "report/deep/V02.tsv", 0.06, "-", 80)
    return folder


def test_stages_add_up_longest_first(benchmarks, tmp_path):
    frame = stages(benchmarks).set_index("rule")
    assert list(frame.index) == ["pretrain", "finetune", "report", "all"]
    assert frame.loc["pretrain"].tolist() == [2, 40, 20, 30, 60, 530]
    assert frame.loc["finetune"].tolist() == [1, 5, 5, 5, 4, 900]
    assert frame.loc["report"].tolist() == [2, pytest.approx(0.1), pytest.approx(0.05), 0.06, 0, 80]
    assert frame.loc["all"].tolist() == [5, pytest.approx(45.1), pytest.approx(9.02), 30, 64, 900]
    write(tabulate(benchmarks, "test clinic"), tmp_path / "stages.csv")
    assert len(read_table(tmp_path / "stages.csv", STAGES)) == 4
    assert "| pretrain | 2 | 40.0 | 20.0 | 30.0 | 60.0 | 530 |" in (tmp_path / "stages.md").read_text()
    assert "test clinic" in (tmp_path / "stages.html").read_text() and (tmp_path / "stages.tex").exists()


def test_what_was_not_measured_is_nan_and_a_study_without_benchmarks_has_a_row_of_zeros(benchmarks, tmp_path):
    frame = read_benchmark(benchmarks / "report/V01.tsv")
    assert frame["s"].tolist() == [0.04] and frame[["cpu_time", "max_rss"]].isna().all(None)
    assert stages(tmp_path / "nowhere").iloc[0, :3].tolist() == ["all", 0, 0]


def network(path):
    net = torch.nn.Sequential(torch.nn.Linear(3, 4), torch.nn.BatchNorm1d(4))
    torch.save({"state": net.state_dict() | {"index": torch.arange(7)}, "network": {}}, path)
    return str(path)


def test_parameters_are_the_trained_floats(tmp_path):
    assert parameters(network(tmp_path / "network.pt")) == 3 * 4 + 4 + 4 + 4


RULE = {"part": 0.25, "fall": 0.02}


def history(path, done, late, held_back):
    """A history of so many steps whose error is 1, and `late` from four fifths of them on."""
    lines = [",".join(COLUMNS)]
    for step in range(done):
        value = late if step >= 0.8 * done else 1.0
        row = {"step": step, "learning_rate": 1e-3, "data": value}
        if held_back and step % 10 == 0:
            row["validation"] = value
        lines.append(",".join(str(row.get(name, "nan")) for name in COLUMNS))
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def test_the_budget_of_methods_with_and_without_a_batch(benchmarks, tmp_path):
    files = [network(tmp_path / f"{fold}.pt") for fold in (1, 2)]
    phase = {"steps": 200, "validation": 1, "learning_rate": 1e-3}
    settings = {
        "net": {"pretraining": phase, "finetuning": phase | {"batch": 4}},
        "once": {"pretraining": phase, "finetuning": None},
    }
    histories = {}
    for method, phase, rise in (("net", "pretraining", 1.0), ("net", "finetuning", 0.5), ("once", "pretraining", 1.0)):
        histories[method, phase] = [
            history(tmp_path / f"{method}{phase}{fold}.csv", done, rise, fold == 1 and method == "net")
            for fold, done in ((1, 200), (2, 160))
        ]
    frame = budget(settings, dict.fromkeys(settings, files), ["1", "2"], str(benchmarks), histories, RULE)
    net, once = frame.to_dict("records")
    assert (net["method"], net["parameters"], net["folds"]) == ("net", 24, 2)
    assert (net["pretraining_samples"], net["finetuning_steps"], net["finetuning_samples"]) == (200, 200, 800)
    assert (net["pretraining_seconds"], net["finetuning_seconds"], net["finetuning_validation"]) == (20, 5, 1)
    assert np.isnan([once["finetuning_steps"], once["finetuning_samples"], once["pretraining_seconds"]]).all()
    assert (net["pretraining_done"], net["pretraining_flat"], net["pretraining_curve"]) == (160, 2, "trained on")
    assert (net["finetuning_flat"], net["finetuning_fall"]) == (0, 50) and once["finetuning_curve"] == ""
    write(table(frame, "test clinic", RULE), tmp_path / "training.csv")
    assert len(read_table(tmp_path / "training.csv", TRAINING)) == 2
    text = (tmp_path / "training.md").read_text()
    net, once = (next(line for line in text.splitlines() if line.startswith(f"| {name} |")) for name in ("net", "once"))
    cells = [cell.strip().replace("\\", "") for cell in net.split("|")[2:-1]]
    steps = "160 of 200 + 160 of 200"
    flat = "2 (0.00 %)* + 0 (50.00 %)*"
    assert cells == ["24", steps, "200 + 800", "20.0 + 5.0", "1 + 1", flat]
    assert "| once | 24 | 160 of 200 + none | 200 + none | none + none |" in once
