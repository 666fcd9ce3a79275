"""Makes the post-operative skin in the patient's own frame of the scan in any frame."""

import logging

from pinnochio.importing.postop_skin import registered_skin
from pinnochio.model.postop import PostopSkin


def register_postop(
    case: str, postop: str, skin: str, bone: str, nasion_above_maxilla: float, limit: float, registered: str, **bones
) -> None:
    """Write points (k, 3) mm LPS, faces (l, 3), the residual and what is uncertain of the face; arguments, those of
    `bones` too, and what is refused (InputError): as of :func:`registered_skin`."""
    fit, points, faces = registered_skin(postop, case, skin, bone, nasion_above_maxilla, limit, **bones)
    logging.info("residual: median %.3f mm, p95 %.3f mm", fit.median, fit.p95)
    logging.info("the face may be off by %.2f mm (p95), in the mean by %.2f mm (95%%)", fit.face_p95, fit.face_bias)
    PostopSkin(fit.motion.apply(points), faces, fit.median, fit.face_p95, fit.face_bias).write(registered)
