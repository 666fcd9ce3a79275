"""The columns of cases.csv: everything that is measured of one prediction."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

from pinnochio.columns import TESTED, Column, number, words
from pinnochio.metrics.region_errors import LANDMARKS, SHOWN

CASES = (
    Column("case", str, "", "patient"),
    Column("fold", str, "", "fold in which the patient was held out"),
    Column("method", str, "", "method that predicted"),
    Column("seed", int, "", "seed of the study"),
    Column("device", str, "", "device that predicted"),
    Column("code", str, "", "content hash of the code"),
    Column("muscle", str, "", "muscle layer: labelled, derived by rule, or single (none)"),
    number("cd", "mm", "half the sum of both directed mean point-to-triangle distances", TESTED),
    number("cd_sum", "mm", "sum of both directed means"),
    number("cd_sq", "mm2", "mean squared distance of both directions"),
    number("cd_vertex", "mm", "as cd, to the nearest vertex"),
    number("hd95", "mm", "larger directed 95th percentile"),
    number("p99", "mm", "larger directed 99th percentile"),
    number("hdmax", "mm", "larger directed maximum"),
    number("apart", "mm", "largest distance of a skin point from the nearest other method's prediction there"),
    number("hd_mean_oneway", "mm", "mean distance of the target from the prediction"),
    number("pwr1", "%", "judged skin predicted within 1 mm of the target, by area before surgery", ".3f"),
    number("pwr2", "%", "judged skin predicted within 2 mm of the target, by area before surgery", ".3f"),
    number("pwr1_target", "%", "target area within 1 mm of the prediction", ".3f"),
    number("pwr2_target", "%", "target area within 2 mm of the prediction", ".3f"),
    number("target_samples", "", "judged samples of the target, equal for all methods", ".0f"),
    number("skin_samples", "", "judged samples of the skin, equal for all methods", ".0f"),
    number("min_jacobian", "", "smallest det F of an element"),
    number("p1_jacobian", "", "1st percentile of det F"),
    number("inverted", "", "elements with det F <= 0", ".0f"),
    number("raw_min_jacobian", "", "min_jacobian of a learned method's field before repair and corrections"),
    number("raw_inverted", "", "inverted of a learned method's field before repair and corrections", ".0f"),
    number("repaired", "", "elements solved again by the inversion repair", ".0f"),
    number("damping", "", "factor of the inversion repair on the whole field; 1: none"),
    number("volume_change_muscle", "%", "volume change of the muscle"),
    number("volume_change_superficial", "%", "volume change of the superficial tissue"),
    number("eqres_paper", "mN2", "mean squared residual force of free nodes", ".4g"),
    number("eqres_rms", "mN", "root of the mean squared residual force of free nodes", ".4g"),
    number("eqres_rel", "", "residual force of free nodes over the force of all others", ".4g"),
    number("load_rel", "", "declared load on free nodes over the force of all others", ".4g"),
    number("raw_eqres_paper", "mN2", "eqres_paper of a learned method's field before repair and corrections", ".4g"),
    number("raw_eqres_rel", "", "eqres_rel of a learned method's field before repair and corrections", ".4g"),
    number("eqres_disp", "mm", "mean displacement of free nodes towards equilibrium", ".4g"),
    Column("eqres_element", str, "", "element type of the residual", optional=True),
    number("moving_error", "mm", "mean error of moving nodes against the plan"),
    number("sliding_error", "mm", "mean change of the sliding nodes' distance from the moved bone"),
    number("interface_error", "mm", "mean distance of the bone contact from the interface network's"),
    *(
        column
        for name in SHOWN
        for column in (
            number(f"region_{name}", "mm", f"mean distance of the target's points on the {words(name)}", TESTED),
            number(
                f"bias_{name}",
                "mm",
                f"signed distance on the {words(name)}, positive where the prediction lies outside",
            ),
        )
    ),
    number("volume_error_mean", "mm", "mean error over the tissue's volume against the simulated outcome", TESTED),
    number("volume_error_p95", "mm", "95th percentile of the error over the tissue's volume"),
    number("skin_error_mean", "mm", "mean error over the skin's area against the simulated outcome", TESTED),
    number("skin_error_p95", "mm", "95th percentile of the error over the skin's area"),
    *(
        number(f"landmark_{name}", "mm", f"error at {words(name)} against the simulated outcome", TESTED)
        for name in LANDMARKS
    ),
    number("seconds", "s", "one plan, warm, without reading files", ".3f"),
    number("setup_seconds", "s", "preparation of a patient, for all plans", ".3f"),
    Column("threads", int, "", "CPU threads; 0 where unknown"),
    Column("nodes", int, "", "nodes of the mesh"),
    Column("converged", bool, "", "whether the solver converged; true without one"),
    Column("reason", str, "", "why the solver stopped", optional=True),
    number("registration_residual", "mm", "median residual of the scan's registration"),
    number("registration_p95", "mm", "95th percentile of how far the registration may be off the judged face"),
    number("registration_bias", "mm", "95% bound of the mean along the normals by which it may be off there"),
)
BY_NAME = {column.name: column for column in CASES}


def scanned(cases: "pd.DataFrame") -> "pd.DataFrame":
    """The rows of CASES whose patient has a post-operative scan."""
    return cases[cases["registration_residual"].notna()]
