"""Files of several patients in one folder: by name, without a copy, and none without being missed."""

import os
from pathlib import Path

import pytest

from pinnochio.errors import InputError
from pinnochio.gathered import gathered, gathered_name
from scripts.prediction.gather import gather


@pytest.mark.parametrize("linked", [True, False])
def test_each_patients_file_is_there_by_its_name(tmp_path, monkeypatch, linked):
    if not linked:  # a disk without hard links
        monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError))
    folders = []
    for fold, cases in (("1", ["B", "A"]), ("2", ["C"])):
        files = [tmp_path / f"{case}.h5" for case in cases]
        for file in files:
            file.write_text(file.stem)
        folders.append(str(tmp_path / fold))
        gather(map(str, files), [gathered_name(case, "lips/model.h5") for case in cases], folders[-1])
    paths = gathered(folders, ["C", "A"], "lips/model.h5")
    assert [Path(path).read_text() for path in paths] == ["C", "A"]
    assert os.path.samefile(paths[1], tmp_path / "A.h5") is linked
    assert gathered([], ["C"], "lips/model.h5") == []
    assert gathered(folders, ["C", "A"], "lips/true_motion.h5", some=False) == []
    with pytest.raises(InputError, match="'D'.*there is no lips/model.h5"):
        gathered(folders, ["C", "D"], "lips/model.h5", some=False)
