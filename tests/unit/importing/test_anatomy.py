"""The anatomy of a head against the frame of its file: what is turned, mirrored, stretched or unnamed is refused."""

import re

import numpy as np
import pytest

from pinnochio.errors import InputError
from pinnochio.model.labels import internal_codes
from tests.helpers import tools
from tests.helpers.virtual_heads import virtual_head

SPACING = 3.0
UNCUT = ("lefort1", "mandible")


@pytest.fixture(scope="module")
def head():
    return virtual_head("class_iii", SPACING)


def imported(folder, head, labels=None, spacing=(SPACING,) * 3, direction=None, segments=None, values=None, **settings):
    """Import the head's labels, or other ones, as a file with this header; returns its report."""
    stored = tools.write(folder / "P1.nii.gz", head.labels if labels is None else labels, head, direction, spacing)
    usual = {"segments": head.segments if segments is None else segments, "repair_limit": 2.0}
    values = internal_codes(head.segments) if values is None else values
    return tools.run(folder, stored, values, cuts=(), **usual, **settings)[0]


def uncut(head):
    """The same head with a mandible in one piece: nothing in it tells left from right."""
    return np.where(head.labels > 12, 12, head.labels)


WRONG = {
    "upside down and turned": ({"direction": np.diag([-1, 1, -1])}, "upside down and left and right are exchanged"),
    "mirrored": ({"direction": np.diag([-1, 1, 1])}, "left and right are exchanged .'proximal_left' lies on the right"),
    "face to one side": ({"direction": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}, "lies on its side"),
    "slices half as far apart": ({"spacing": (3.0, 3.0, 1.5)}, r"its height is 0\.[34]\d of its width"),
    "pixels twice as large": ({"spacing": (6.0, 6.0, 3.0)}, "mm wide.*people's are"),
}  # fmt: skip


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_header_is_refused_with_the_likely_remedy(head, wrong, tmp_path):
    change, words = WRONG[wrong]
    with pytest.raises(InputError, match=words) as caught:
        imported(tmp_path, head, **change)
    assert "orientation" in caught.value.remedy or "spacing" in caught.value.remedy
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("axes", [[-1, -1, 1], [1, 1, -1], [-1, 1, -1]])
def test_the_remedy_is_the_one_that_helps(head, axes, tmp_path):
    with pytest.raises(InputError) as caught:
        imported(tmp_path, head, direction=np.diag(axes))
    code = re.search(r"probably (\w{3})", caught.value.remedy)[1]
    frame = imported(tmp_path, head, direction=np.diag(axes), orientation=code)["frame"]
    assert set(frame.values()) == {"as it should be"}


def test_a_good_head_says_what_was_seen_and_what_nothing_tells(head, tmp_path):
    assert set(imported(tmp_path, head)["frame"].values()) == {"as it should be"}
    frame = imported(tmp_path, head, labels=uncut(head), segments=UNCUT, values=internal_codes(UNCUT))["frame"]
    assert frame["front"] == "as it should be" and "nothing labelled tells left from right" in frame["sides"]


def test_a_head_without_sides_still_may_not_look_backwards(head, tmp_path):
    with pytest.raises(InputError, match="looks backwards.*make sure which side is left"):
        imported(
            tmp_path, head, uncut(head), segments=UNCUT, values=internal_codes(UNCUT), direction=np.diag([-1, -1, 1])
        )


def piece(head, value=77):
    """The head whose chin, some 16 % of the distal segment, has a value of its own."""
    labels = head.labels.copy()
    jaw = np.argwhere(labels == 12)
    front = jaw[np.argsort(jaw[:, 1])[: round(0.16 * len(jaw))]]
    labels[tuple(front.T)] = value
    return labels


def test_a_piece_of_bone_that_nothing_names_is_refused(head, tmp_path):
    with pytest.raises(InputError, match=r"of 77 beside '\w+' .*nothing in 'labels' names.*left_out"):
        imported(tmp_path, head, piece(head))


def test_a_label_that_is_no_segment_has_a_message_for_it(head, tmp_path):
    values = internal_codes(head.segments) | {"chin": 77}
    with pytest.raises(InputError, match="'labels' calls them 'chin', which is not among 'segments'"):
        imported(tmp_path, head, piece(head), values=values)


def test_what_is_air_on_purpose_goes_in(head, tmp_path):
    labels = head.labels.copy()
    air = labels == 0
    inner = air & (np.cumsum(labels > 2, axis=1) > 0) & (np.cumsum((labels > 2)[:, ::-1], axis=1)[:, ::-1] > 0)
    labels[inner] = 77  # mouth and airway, labelled
    with pytest.raises(InputError, match="would become air"):
        imported(tmp_path, head, labels)
    values = internal_codes(head.segments) | {"left_out": [77]}
    assert imported(tmp_path, head, labels, values=values)["repairs"] == imported(tmp_path, head)["repairs"]
