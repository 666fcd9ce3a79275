"""The core's parts of the report: each a table under its title, in the order of the page."""

PARTS = {
    "accuracy": "Accuracy",
    "better": "Accuracy against PINNOCHIO plus",
    "planned": "Accuracy from the plan",
    "ablation": "Ablation",
    "claims": "The paper's claims",
    "regions": "Regions of the face",
    "landmarks": "Landmarks, skin and volume",
    "segments": "Registered motions of the bones",
    "quality": "Quality of the patients' models",
    "stages": "Time of every stage",
    "training": "Training",
}

# Parts for those who look after a study: shown when they are opened.
FOLDED = ("quality", "stages", "training")
