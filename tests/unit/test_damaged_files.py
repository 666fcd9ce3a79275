"""A damaged file of the study is refused by its name, with a remedy, and never with another library's error."""

import json

import pytest

from pinnochio.columns import Column, number, read_table
from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json
from pinnochio.patients.in_distribution import Ranges
from pinnochio.statistics.intervals import Calibration
from pinnochio.training.convergence import convergence
from pinnochio.training.loop import COLUMNS as HISTORY

COLUMNS = (Column("case", str, "", "patient"), Column("n", int, "", "scans"), number("cd", "mm", "distance"))
WHOLE = "case,n,cd\nP1,2,0.5\nP2,3,\n"
DAMAGES = {
    "empty": (b"", "it is empty"),
    "UTF-16": (WHOLE.encode("utf-16"), "no text in UTF-8"),
    "rubbish": (bytes(range(256)), "no text in UTF-8"),
    "NUL": (bytes(300) + b"\n", "it has no row"),
    "cut header": (b"case,n,c", "it is cut off"),
    "cut row": (WHOLE[:-3].encode(), "it is cut off"),
    "cut after the header": (b"case,n,cd\n", "it has no row"),
    "missing column": (b"case,cd\nP1,0.5\n", "column 'n' is missing"),
    "comma for a point": (b"case,n,cd\nP1,2,0,5\n", "more cells than its first line"),
    "long row": (WHOLE.encode() + b"P3,2,0,5\n", "Expected 3 fields"),
    "endless quote": (b'"' + WHOLE.encode(), "cannot be read"),
    "a word": (b"case,n,cd\nP1,two,0.5\n", "column 'n' holds something that is not a whole number"),
}


def refused(read, path, said):
    with pytest.raises(InputError, match=said) as caught:
        read(path)
    assert caught.value.case == "-" and caught.value.file == str(path) and len(caught.value.remedy) > 5


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_table_is_refused(damage, tmp_path):
    content, said = DAMAGES[damage]
    (tmp_path / "a.csv").write_bytes(content)
    refused(lambda path: read_table(path, COLUMNS), tmp_path / "a.csv", said)


def test_a_table_that_is_not_there_is_refused_and_a_whole_one_is_read(tmp_path):
    refused(lambda path: read_table(path, COLUMNS), tmp_path / "a.csv", "No such file")
    for content in (WHOLE, "\ufeff" + WHOLE, WHOLE.replace("\n", "\r\n")):
        (tmp_path / "a.csv").write_bytes(content.encode())
        assert read_table(tmp_path / "a.csv", COLUMNS).fillna(0).to_numpy().tolist() == [["P1", 2, 0.5], ["P2", 3, 0]]


@pytest.mark.parametrize(
    ("content", "said"),
    [("", "is not JSON"), ('{"a": [1, 2', "is not JSON"), ("[1, 2]\n", "no object"), ("null\n", "no object")],
)
def test_damaged_json_is_refused(content, said, tmp_path):
    (tmp_path / "a.json").write_text(content)
    refused(read_stored_json, tmp_path / "a.json", said)


def test_a_key_that_is_missing_is_named_at_any_depth(tmp_path):
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"anatomy": {"low": {}, "high": {}, "threshold": 0.1, "patients": 9}}))
    refused(Ranges.read, path, "it holds no 'false_alarm'")
    refused(Calibration.read, path, "it holds no 'method'")


@pytest.mark.parametrize("content", ["step,total\n1,2\n", f"{','.join(HISTORY)}\n1,a,3,4,5,6,7,8,9,0\n"])
def test_a_damaged_history_is_refused(content, tmp_path):
    (tmp_path / "a.csv").write_text(content)
    refused(lambda path: convergence(path, 0.25), tmp_path / "a.csv", "cannot be read")
