"""The coarse virtual head of the stages' tests."""

from pathlib import Path

import pytest

from pinnochio.virtual import head
from pinnochio.virtual.procedures import Procedure
from scripts.cohort.virtual_patient import virtual_patient
from scripts.patient.import_plan import import_plan
from scripts.patient.import_segmentation import import_labels, import_surfaces
from scripts.patient.label_interfaces import label_case
from scripts.patient.tetrahedralize import mesh_case
from tests.helpers.settings import CONFIG, SEED

IMPORTED = {"labels": "labels.nii.gz", "bone": "bone.vtp", "skin": "skin.vtp", "report": "report.json"}


def make_head(*arguments) -> None:
    """A virtual patient whose tissue over bone is as thin as in heads of 1 mm: the tests expect what it gives."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(head, "BETWEEN", 0.0)
        virtual_patient(*arguments)


def import_head(*arguments, outputs: dict[str, str], **settings) -> None:
    """Labels, and surfaces with edges of 6 mm, as an import's two stages make them."""
    head, others = f"{outputs['labels']}.json", {name: outputs[name] for name in ("bone", "skin", "report")}
    import_labels(*arguments, bone_edge=6.0, head=head, labels=outputs["labels"], **settings)
    import_surfaces(outputs["labels"], head, 6.0, **others)


def modelled(case: str, number: int, folder: Path, procedure: Procedure, nodes: int) -> dict[str, str]:
    """Files of a head of 2 mm that is operated so, imported, meshed with so many nodes and labelled, by their names."""
    sources = {"segmentation": "segmentation.nii.gz", "plan": "input_plan.json", "landmarks": "landmarks.json"}
    names = sources | {"anatomy": "anatomy.json", "imported_plan": "plan.json", "mesh": "mesh.vtu", "model": "model.h5"}
    files = {name: str(folder / file) for name, file in (names | IMPORTED).items()}
    made = {name: files[name] for name in (*sources, "anatomy")}
    make_head(case, number, SEED, 2.0, CONFIG["labels"], procedure, made)
    values, vocabulary = CONFIG["labels"], tuple(CONFIG["segments"])
    outputs = {name: files[name] for name in IMPORTED}
    import_head(case, files["segmentation"], values, vocabulary, "header", 2.0, "derived", outputs=outputs)
    import_plan(case, files["plan"], files["bone"], files["imported_plan"])
    mesh_case(files["labels"], nodes, 12.0, files["mesh"])
    read = (files[name] for name in ("mesh", "labels", "bone", "skin", "report"))
    label_case(*read, CONFIG["interfaces"], files["model"])
    return files
