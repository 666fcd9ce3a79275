"""The columns of cases.csv: everything that is measured of one prediction."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

from pinnochio.columns import TESTED, Column, number, words
from pinnochio.metrics.regions import LANDMARKS, REGIONS

CASES = (
    Column("case", str, "", "patient"),
    Column("fold", str, "", "fold in which the patient was held out"),
    Column("method", str, "", "method that predicted"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that predicted"),
    Column("code", str, "", "content hash of the code"),
    Column("muscle", str, "", "where the muscle layer comes from: labelled, derived (by rule) or single (no layer)"),
    number("cd", "mm", "half the sum of the two directed mean point-to-triangle distances", TESTED),
    number("cd_sum", "mm", "sum of the two directed means"),
    number("cd_sq", "mm2", "mean squared distance, both directions averaged"),
    number("cd_vertex", "mm", "as cd, to the nearest vertex"),
    number("hd95", "mm", "larger of the two directed 95th percentiles"),
    number("hdmax", "mm", "larger of the two directed maxima"),
    number("hd_mean_oneway", "mm", "mean distance of the target from the prediction"),
    number("pwr1", "%", "judged skin that is predicted within 1 mm of the target, by its area before surgery", ".3f"),
    number("pwr2", "%", "judged skin that is predicted within 2 mm of the target, by its area before surgery", ".3f"),
    number("pwr1_target", "%", "target area within 1 mm of the prediction", ".3f"),
    number("pwr2_target", "%", "target area within 2 mm of the prediction", ".3f"),
    number("target_samples", "", "judged samples of the target, the same for every method of the case", ".0f"),
    number("skin_samples", "", "judged samples of the skin, the same for every method of the case", ".0f"),
    number("min_jacobian", "", "smallest det F of an element"),
    number("p1_jacobian", "", "1st percentile of det F"),
    number("inverted", "", "elements with det F <= 0", ".0f"),
    number("raw_min_jacobian", "", "min_jacobian of a learned method's own field, before repair and corrections"),
    number("raw_inverted", "", "inverted of that field", ".0f"),
    number("repaired", "", "elements that the inversion repair solved again", ".0f"),
    number("damping", "", "factor of the inversion repair on the whole field, 1 for none"),
    number("volume_change_muscle", "%", "change of the muscle's volume"),
    number("volume_change_superficial", "%", "change of the superficial tissue's volume"),
    number("eqres_paper", "mN2", "mean squared residual force of the free nodes", ".4g"),
    number("eqres_rms", "mN", "root of the mean squared residual force of the free nodes", ".4g"),
    number("eqres_rel", "", "residual force of the free nodes over the force of all others", ".4g"),
    number("load_rel", "", "declared load on the free nodes over the force of all others; 0 where none is", ".4g"),
    number("raw_eqres_paper", "mN2", "eqres_paper of a learned method's own field", ".4g"),
    number("raw_eqres_rel", "", "eqres_rel of that field", ".4g"),
    number("eqres_disp", "mm", "mean displacement that a free node still wants", ".4g"),
    Column("eqres_element", str, "", "element of the residual", optional=True),
    number("moving_error", "mm", "mean error of the moving nodes against the plan"),
    number(
        "sliding_error",
        "mm",
        "mean change of the sliding nodes' distance from the moved bone that the solver slides them on",
    ),
    number("interface_error", "mm", "mean distance of the bone contact from where the interface network puts it"),
    *(
        column
        for name in REGIONS
        for column in (
            number(f"region_{name}", "mm", f"mean distance of the target's points on the {words(name)}", TESTED),
            number(f"bias_{name}", "mm", "the same, signed: positive where the prediction lies outside the target"),
        )
    ),
    number("volume_error_mean", "mm", "mean error over the tissue's volume against the virtual truth", TESTED),
    number("volume_error_p95", "mm", "95th percentile of it"),
    number("skin_error_mean", "mm", "mean error over the skin's area against the virtual truth", TESTED),
    number("skin_error_p95", "mm", "95th percentile of it"),
    *(
        number(f"landmark_{name}", "mm", f"error at {words(name)} against the virtual truth", TESTED)
        for name in LANDMARKS
    ),
    number("seconds", "s", "one plan, warm, without reading files", ".3f"),
    number("setup_seconds", "s", "what belongs to the patient and serves every plan", ".3f"),
    Column("threads", int, "", "CPU threads; 0 where unknown"),
    Column("nodes", int, "", "nodes of the mesh"),
    Column("converged", bool, "", "whether the solver converged; true where there is none"),
    Column("reason", str, "", "why the solver stopped", optional=True),
    number("registration_residual", "mm", "median residual of the scan's registration"),
)
BY_NAME = {column.name: column for column in CASES}


def scanned(cases: "pd.DataFrame") -> "pd.DataFrame":
    """The rows of CASES whose patient has a post-operative scan."""
    return cases[cases["registration_residual"].notna()]
