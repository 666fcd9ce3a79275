"""Segmentations as DICOM-SEG, with the slices of a CT that they belong to."""

import highdicom
import numpy as np
from pydicom import Dataset
from pydicom.dataset import FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid


def scan_slices(shape, direction, spacing, origin, voxels=None, step=None, series="series"):
    """An axial CT as DICOM data sets, of air or of voxels [ix, iy, iz]; shape, spacing: columns, rows, slices.

    step (3,) mm: way from slice to slice, where it is not that of an upright gantry.
    """
    step = spacing[2] * direction[:, 2] if step is None else step
    series, study, frame = (generate_uid(entropy_srcs=[name]) for name in (series, "study", "frame"))
    slices = []
    for number in range(shape[2]):
        made = Dataset()
        made.SOPClassUID, made.SOPInstanceUID = CTImageStorage, generate_uid(entropy_srcs=[f"slice {number}"])
        made.file_meta = FileMetaDataset()
        made.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        made.StudyInstanceUID, made.SeriesInstanceUID, made.FrameOfReferenceUID = study, series, frame
        made.PatientID = made.PatientName = made.PatientBirthDate = made.PatientSex = made.AccessionNumber = ""
        made.StudyID = made.StudyDate = made.StudyTime = made.ReferringPhysicianName = (
            made.PositionReferenceIndicator
        ) = ""
        made.SeriesNumber, made.InstanceNumber, made.Modality = 1, number + 1, "CT"
        made.Columns, made.Rows = shape[0], shape[1]
        made.PixelSpacing, made.SliceThickness = [spacing[1], spacing[0]], spacing[2]
        made.ImageOrientationPatient = [*direction[:, 0], *direction[:, 1]]
        made.ImagePositionPatient = list(np.round(origin + number * step, 6))
        made.SamplesPerPixel, made.PhotometricInterpretation, made.PixelRepresentation = 1, "MONOCHROME2", 1
        made.BitsAllocated = made.BitsStored = 16
        made.HighBit, made.ImageType = 15, ["ORIGINAL", "PRIMARY", "AXIAL"]
        made.RescaleSlope, made.RescaleIntercept = "1", "-1024"
        stored = np.zeros(shape[1::-1], np.int16) if voxels is None else voxels[..., number].T + 1024
        made.PixelData = np.ascontiguousarray(stored, "<i2").tobytes()
        slices.append(made)
    return slices


def save_series(folder, voxels, direction, spacing, origin, step=None, left_out=(), series="series"):
    """The slices of a CT, voxels [ix, iy, iz] in HU, as files without an ending, in another order than they lie."""
    folder.mkdir(exist_ok=True)
    values = np.rint(voxels).astype(np.int16)
    for number, made in enumerate(scan_slices(values.shape, direction, spacing, origin, values, step, series)):
        if number not in left_out:
            made.save_as(folder / f"IM{(7 * number) % 1009:04d}", enforce_file_format=True)
    return folder


def save_frames(path, voxels, direction, spacing, origin, left_out=()):
    """The same as the frames of one file, in another order than they lie."""
    values = np.rint(voxels).astype(np.int16)
    slices = scan_slices(values.shape, direction, spacing, origin, values)
    kept = [one for number, one in enumerate(slices) if number not in left_out]
    uids = generate_uid(entropy_srcs=["frames"]), 1, generate_uid(entropy_srcs=["file"]), 1
    made = highdicom.legacy.LegacyConvertedEnhancedCTImage(kept, *uids)
    order = np.random.default_rng(0).permutation(len(kept))
    pixels = np.frombuffer(made.PixelData, np.int16).reshape(len(kept), -1)
    made.PixelData = pixels[order].tobytes()
    made.PerFrameFunctionalGroupsSequence = [made.PerFrameFunctionalGroupsSequence[number] for number in order]
    made.save_as(path)


def save_dicom_seg(path, masks, names, direction, spacing, origin, fractional=False):
    """Segments of these names from masks [iz, iy, ix, segment]."""
    code = highdicom.sr.CodedConcept("123037004", "SCT", "Anatomical structure")
    manual = highdicom.seg.SegmentAlgorithmTypeValues.MANUAL
    highdicom.seg.Segmentation(
        source_images=scan_slices(masks.shape[2::-1], direction, spacing, origin),
        pixel_array=masks.astype(np.float32) * 0.8 if fractional else masks.astype(np.uint8),
        segmentation_type="FRACTIONAL" if fractional else "BINARY",
        segment_descriptions=[
            highdicom.seg.SegmentDescription(number, name, code, code, manual)
            for number, name in enumerate(names, start=1)
        ],
        series_instance_uid=generate_uid(),
        series_number=2,
        sop_instance_uid=generate_uid(),
        instance_number=1,
        manufacturer="none",
        manufacturer_model_name="none",
        software_versions="0",
        device_serial_number="0",
    ).save_as(path)
