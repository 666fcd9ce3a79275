"""3D Slicer module: predicts the face of a patient whose segmentation and planned transforms are in the scene.

Scripted module of one file. What needs Slicer is in the classes at the end; all else is plain Python and is tested. The
classes were not run in Slicer: each call was looked up in the sources of Slicer and CTK [S].
"""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

try:
    import ctk
    import qt
    from slicer.ScriptedLoadableModule import (
        ScriptedLoadableModule,
        ScriptedLoadableModuleLogic,
        ScriptedLoadableModuleWidget,
    )

    import slicer
except ImportError:  # outside Slicer: the functions alone
    slicer = None

TOOLS = ("dentalsegmentator", "nasomaxilla", "universal", "amasss", "totalsegmentator")
METHODS = ("pinnochio_plus", "fem_sliding", "fem_bonded", "elastic")
PLAN = "slicer"
# Of a bone without a transform, as Slicer saves one that moves nothing.
STAYS = """#Insight Transform File V1.0
#Transform 0
Transform: AffineTransform_double_3_3
Parameters: 1 0 0 0 1 0 0 0 1 0 0 0
FixedParameters: 0 0 0
"""


def patient_name(text: str) -> str:
    """A case name of letters, digits, '-' and '_' from what the user calls the patient."""
    name = re.sub(r"[^0-9A-Za-z_-]+", "_", text).strip("_")
    if not name:
        raise ValueError("give the patient a name of letters and digits")
    return name


def prepare(
    folder: Path, segmentation: Path, volume: Path | None, transforms: dict[str, Path | None], markups=()
) -> Path:
    """Lay out a patient's folder: segmentation, scan, markups, a transform per bone segment, None where it stays.

    Returns it. Files of an earlier run of the same plan are replaced, other plans stay.
    """
    if not any(transforms.values()):
        raise ValueError("choose a transform for at least one bone segment")
    plan = folder / "plans" / PLAN
    shutil.rmtree(plan, ignore_errors=True)
    plan.mkdir(parents=True)
    for old in [*folder.glob("segmentation.*"), *folder.glob("volume.*"), *folder.glob("*.mrk.json")]:
        old.unlink()
    ending = "".join(Path(segmentation).suffixes[-2:]) or Path(segmentation).suffix
    shutil.copy(segmentation, folder / f"segmentation{ending}")
    if volume:
        shutil.copy(volume, folder / f"volume{''.join(Path(volume).suffixes[-2:])}")
    for file in markups:
        shutil.copy(file, folder / Path(file).name)
    for segment, file in transforms.items():
        if file:
            shutil.copy(file, plan / f"{segment}{Path(file).suffix}")
        else:
            (plan / f"{segment}.tfm").write_text(STAYS, encoding="utf-8")
    return folder


def command(project: Path, folder: Path, labels: str, method: str, models: str = "", cores: int = 2) -> list[str]:
    """The command that predicts the patient of a folder, run in the project's folder."""
    program = Path(project) / ".venv" / ("Scripts" if os.name == "nt" else "bin") / "snakemake"
    config = [f"patient={folder}", f"predict={{method: {method}}}"]
    config += [f"labels={labels}"] if labels else []
    config += [f"models={models}"] if models else []
    return [str(program), "--cores", str(cores), "predict", "--config", *config]


def refusal(said: str) -> str:
    """What the project refuses, of all that Snakemake says: problem and remedy; else its last lines."""
    found = re.search(r"case '[^']*': .*?Remedy: .*?\.(?=\s|$)", said, re.S)
    return " ".join(found[0].split()) if found else "\n".join(said.strip().splitlines()[-12:])


def results(project: Path, name: str, method: str) -> dict:
    """Files of the prediction: skin (with displacement and, of a learned method, the interval), bones, page, picture.

    certificate: its content. FileNotFoundError where there is no prediction.
    """
    home = Path(project) / "results/patients" / name
    folder = home / PLAN / method
    skin = folder / "skin.vtp"
    if not skin.is_file():
        raise FileNotFoundError(f"there is no prediction in {folder}")
    return {
        "skin": skin,
        "bones": {file.stem: file for file in sorted((folder / "bones").glob("*.stl"))},
        "page": folder / "index.html",
        "picture": home / "segments.png",
        "certificate": json.loads((folder / "certificate.json").read_text(encoding="utf-8")),
    }


def predict(
    project: Path, folder: Path, labels: str, method: str, models: str = "", env=None, run=subprocess.run
) -> dict:
    """Run the prediction and return its files; RuntimeError with what the project refuses.

    env: variables in place of this process's, which in Slicer lead to its own Python and libraries.
    """
    done = run(
        command(project, folder, labels, method, models),
        cwd=project,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(refusal(done.stdout))
    return results(project, Path(folder).name, method)


if slicer is not None:

    class FacePrediction(ScriptedLoadableModule):
        """What Slicer shows of the module."""

        def __init__(self, parent):
            ScriptedLoadableModule.__init__(self, parent)
            parent.title = "Face prediction"
            parent.categories = ["Planning"]
            parent.helpText = "Predicts the face after jaw surgery. For research only; not a medical device."
            parent.contributors, parent.dependencies = [], []
            parent.acknowledgementText = ""

    class FacePredictionWidget(ScriptedLoadableModuleWidget):
        """Choose, predict, see."""

        def setup(self):
            ScriptedLoadableModuleWidget.setup(self)
            form = qt.QFormLayout()
            self.layout.addLayout(form)
            self.project = ctk.ctkPathLineEdit()
            self.project.filters = ctk.ctkPathLineEdit.Dirs
            self.name = qt.QLineEdit("P01")
            self.segmentation = self._selector(["vtkMRMLSegmentationNode", "vtkMRMLLabelMapVolumeNode"])
            self.volume = self._selector(["vtkMRMLScalarVolumeNode"], none=True)
            self.labels, self.method = qt.QComboBox(), qt.QComboBox()
            self.labels.addItems(TOOLS)
            self.method.addItems(METHODS)
            for title, widget in (
                ("Project", self.project),
                ("Patient", self.name),
                ("Segmentation", self.segmentation),
                ("Scan", self.volume),
                ("Made by", self.labels),
                ("Method", self.method),
            ):
                form.addRow(title, widget)
            self.transforms = {}
            for segment in ("lefort1", "mandible_distal", "proximal_left", "proximal_right"):
                self.transforms[segment] = self._selector(["vtkMRMLLinearTransformNode"], none=True)
                form.addRow(segment, self.transforms[segment])
            button = qt.QPushButton("Predict")
            button.connect("clicked(bool)", self.onPredict)
            self.layout.addWidget(button)
            self.layout.addStretch(1)

        def _selector(self, kinds, none=False):
            made = slicer.qMRMLNodeComboBox()
            made.nodeTypes, made.noneEnabled, made.addEnabled = kinds, none, False
            made.setMRMLScene(slicer.mrmlScene)
            return made

        def onPredict(self):
            with slicer.util.tryWithErrorDisplay("The face could not be predicted.", waitCursor=True):
                chosen = {name: selector.currentNode() for name, selector in self.transforms.items()}
                FacePredictionLogic().run(
                    Path(self.project.currentPath),
                    patient_name(self.name.text),
                    self.segmentation.currentNode(),
                    self.volume.currentNode(),
                    chosen,
                    self.labels.currentText,
                    self.method.currentText,
                )

    class FacePredictionLogic(ScriptedLoadableModuleLogic):
        """Between the scene and the project."""

        def run(self, project, name, segmentation, volume, transforms, labels, method):
            folder = Path(slicer.app.temporaryPath) / "FacePrediction" / name
            files = folder.parent / f"{name}_files"
            files.mkdir(parents=True, exist_ok=True)
            if segmentation is None:
                raise ValueError("choose a segmentation")
            # With the names of its segments: a label map made of it would number those that are there.
            named = segmentation.IsA("vtkMRMLSegmentationNode")
            labelled = self._save(segmentation, files / f"segmentation.{'seg.nrrd' if named else 'nii.gz'}")
            scan = volume and self._save(volume, files / "volume.nii.gz")
            moved = {bone: node and self._save(node, files / f"{bone}.tfm") for bone, node in transforms.items()}
            prepare(folder, labelled, scan, moved)
            made = predict(project, folder, labels, method, env=slicer.util.startupEnvironment())
            skin = slicer.util.loadModel(str(made["skin"]))
            if made["certificate"]["interval"]:
                skin.GetDisplayNode().SetActiveScalarName("half_width")
                skin.GetDisplayNode().SetScalarVisibility(True)
            for file in made["bones"].values():
                slicer.util.loadModel(str(file))
            return made

        def _save(self, node, path):
            if not slicer.util.saveNode(node, str(path)):
                raise RuntimeError(f"{node.GetName()} could not be saved as {path.name}")
            return path
