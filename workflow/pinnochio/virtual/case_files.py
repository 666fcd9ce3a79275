"""Files of a virtual case: name, format, units and frame, content, and who may read it."""

INPUTS = {
    "segmentation.nii.gz": (
        "NIfTI label map, unsigned integers",
        "voxels of the spacing above; world mm (RAS in the file, as NIfTI has it)",
        "tissues and bone segments before surgery; values below",
        "every method",
    ),
    "plan.json": (
        "JSON",
        "LPS, mm; rotation matrices",
        "the planned rigid motion of each segment, x_post = R (x_pre - pivot) + pivot + translation",
        "every method",
    ),
    "landmarks.json": (
        "JSON, name to [x, y, z]",
        "LPS, mm",
        "soft-tissue and bone landmarks before surgery",
        "analysis",
    ),
    "anatomy.json": ("JSON", "as in the parameter table", "sex, deformity and every sampled number", "analysis"),
    "covariates.json": (
        "JSON",
        "years, kg/m2, months",
        "sex, age, body mass index, months to the scan, closure (`vy`, `simple`), alar cinch suture",
        "every method",
    ),
}
OUTCOMES = {
    "postop.ply": (
        "PLY triangles",
        "mm, in the scanner's own frame",
        "scan of the face after surgery: noisy, with holes, partial",
        "training on other folds; evaluation",
    ),
    "postop_bones.nii.gz": (
        "NIfTI label map, unsigned integers",
        "voxels of 0.8 to 1 mm; mm, in the frame of a second scanner",
        "bones after surgery as a segmented scan shows them: noise, plates, callus, streaks, parts out of view; 1 "
        "bone, or 1 skull with upper jaw and 2 lower jaw",
        "every method, by the motions registered on it (`achieved.json`)",
    ),
    "truth.h5": (
        "HDF5: `points` (n, 3), `cells` (m, 4), `displacement` (n, 3); attribute `executed`",
        "LPS, mm",
        "the whole displacement field of the outcome and the plan as it was carried out",
        "**evaluation only**",
    ),
    "executed.json": ("JSON", "LPS, mm", "the plan as it was carried out", "**evaluation only**"),
}
FILES = INPUTS | OUTCOMES
LOCKED = "locked"  # role of a cohort that no setting is chosen on; its outcomes are kept apart
CHECKSUMS, OUTCOME_CHECKSUMS = "SHA256SUMS", "SHA256SUMS.outcomes"
