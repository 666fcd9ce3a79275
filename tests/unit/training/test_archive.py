"""An archive of networks: what is packed comes out again, and nothing else does."""

import json

import pytest

from pinnochio.errors import InputError
from pinnochio.manifest import MANIFEST
from pinnochio.training.network_archive import SHOWN, NetworkArchive, pack, take
from tests.helpers.settings import CONFIG

FOLDS = {"1": ["V01", "V03"], "2": ["V02"]}
METHODS = {"net": {"network": {}, "pretraining": {"steps": 9}, "finetuning": {"steps": 5}}, "face": {"finetuning": {}}}


@pytest.fixture
def archive(tmp_path):
    """Folder of an archive of two methods and two folds, of which one method has no pretraining."""
    for fold in FOLDS:
        for method, phases in METHODS.items():
            folder = tmp_path / "folds" / fold / method
            folder.mkdir(parents=True)
            (folder / "network.pt").write_bytes(f"{method} {fold}".encode())
            for phase in ("pretraining", "finetuning"):
                if phase in phases:
                    (folder / f"{phase}.csv").write_text(f"{phase} of {method} {fold}")
    about = {"held_out": FOLDS, "shown": CONFIG, "provenance": {"made_on": "a machine"}}
    pack(trained=tmp_path / "folds", out=tmp_path / "archive", methods=METHODS, **about)
    return tmp_path / "archive"


def test_what_is_packed_is_known_and_taken(archive, tmp_path):
    read = NetworkArchive.read(archive)
    assert read.methods == METHODS and read.held_out == FOLDS and read.provenance == {"made_on": "a machine"}
    assert set(read.shown) == set(SHOWN) and len(read.files) == 2 * 5 and len(read.sha256) == 64
    outputs = [tmp_path / "out/network.pt", tmp_path / "out/finetuning.csv"]
    take(archive, ["2/net/network.pt", "2/net/finetuning.csv"], outputs)
    assert [path.read_text() for path in outputs] == ["net 2", "finetuning of net 2"]


def test_a_file_that_is_exchanged_is_not_taken_and_the_others_are(archive, tmp_path):
    (archive / "1/net/network.pt").write_bytes(b"another network")
    with pytest.raises(InputError, match="1/net/network.pt.*exchanged"):
        take(archive, ["1/net/network.pt"], [tmp_path / "one.pt"])
    assert not (tmp_path / "one.pt").exists()
    take(archive, ["2/net/network.pt"], [tmp_path / "two.pt"])
    (archive / "2/net/network.pt").unlink()
    with pytest.raises(InputError, match="lacks this file"):
        take(archive, ["2/net/network.pt"], [tmp_path / "two.pt"])


def test_a_manifest_that_was_edited_or_is_of_something_else_is_refused(archive, tmp_path):
    content = json.loads((archive / MANIFEST).read_text())
    (archive / MANIFEST).write_text(json.dumps(content | {"held_out": {"1": [], "2": []}}))
    with pytest.raises(InputError, match="not as it was packed"):
        NetworkArchive.read(archive)
    with pytest.raises(InputError, match="there is no archive"):
        NetworkArchive.read(tmp_path)


def test_networks_of_other_folds_or_another_configuration_are_refused(archive):
    """A network of other folds may have seen whom it is judged on."""
    read = NetworkArchive.read(archive)
    read.refuse_others(archive, CONFIG, FOLDS)
    with pytest.raises(InputError, match="folds"):
        read.refuse_others(archive, CONFIG, {"1": ["V01"], "2": ["V02", "V03"]})
    with pytest.raises(InputError, match="seed, mesh"):
        read.refuse_others(archive, CONFIG | {"seed": 2, "mesh": CONFIG["mesh"] | {"nodes": 700}}, FOLDS)


def test_a_fold_without_its_network_is_not_packed(archive, tmp_path):
    (tmp_path / "folds/2/face/network.pt").unlink()
    about = {"held_out": FOLDS, "shown": CONFIG, "provenance": {}}
    with pytest.raises(InputError, match="2/face/network.pt.*not there"):
        pack(trained=tmp_path / "folds", out=tmp_path / "other", methods=METHODS, **about)
    assert not (tmp_path / "other" / MANIFEST).exists()
