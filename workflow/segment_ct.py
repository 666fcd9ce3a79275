"""Makes a label map of a CT by thresholds and planes, by hand: `python workflow/segment_ct.py --help`."""

import argparse
import sys

from pinnochio.errors import InputError
from pinnochio.importing.segmentation import HEADER, write_segmentation
from pinnochio.importing.thresholding import SEGMENTS, Cuts, Thresholds, read_ct, segment_ct
from pinnochio.model.labels import internal_codes


def segment_file(ct: str, cuts: str, orientation: str, thresholds: Thresholds, labels: str) -> dict[str, float]:
    """Segment a CT file and write the label map; returns the volume of each structure in cm3.

    Raises InputError for what the user must mend.
    """
    head = segment_ct(read_ct(ct, orientation), Cuts.read(cuts), thresholds)
    write_segmentation(head.labels, head.spacing, head.origin, labels)
    voxel = float(head.spacing.prod()) / 1000
    codes = internal_codes(SEGMENTS)
    return {name: voxel * int((head.labels == code).sum()) for name, code in codes.items() if code in head.labels}


def parser() -> argparse.ArgumentParser:
    """The command line; every threshold of :class:`Thresholds` is an option."""
    made = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    made.add_argument("ct", help="CT volume: NRRD, NIfTI or MHA")
    made.add_argument("labels", help="label map to write: .nii.gz or .nrrd")
    made.add_argument("--cuts", required=True, help="JSON with the planes that part the bones, LPS mm")
    made.add_argument(
        "--orientation", default=HEADER, help="where the voxel axes point if the header is wrong, such as LPI"
    )
    for name, meaning, default in Thresholds.options():
        flag = f"--{name.replace('_', '-')}"
        made.add_argument(flag, type=float, default=default, required=default is None, help=meaning)
    return made


if __name__ == "__main__":
    options = vars(parser().parse_args())
    thresholds = Thresholds(**{name: options.pop(name) for name, *_ in Thresholds.options()})
    try:
        volumes = segment_file(**options, thresholds=thresholds)
    except InputError as error:
        sys.exit(str(error))
    print(*(f"{name}: {volume:.1f} cm3" for name, volume in volumes.items()), sep="\n")
