"""What the report can hold: each part a table, a figure or both, under its title, in the order of the page."""

PARTS = {
    "accuracy": "Accuracy",
    "better": "Accuracy against PINNOCHIO plus",
    "planned": "Accuracy from the plan",
    "ablation": "Ablation",
    "claims": "The paper's claims",
    "regions": "Regions of the face",
    "landmarks": "Landmarks, skin and volume",
    "tradeoff": "Seconds against accuracy",
    "corrections": "Newton corrections after the network",
    "learning": "Error against training patients",
    "design": "Switches of PINNOCHIO plus",
    "coverage": "Coverage of the intervals",
    "stability": "Stability at the extremes",
    "scene": "Solving what a plan requires",
    "scaling": "Cost against nodes and patients",
    "segments": "Registered motions of the bones",
    "quality": "Quality of the patients' models",
    "stages": "Time of every stage",
    "training": "Training",
}

# Parts with a figure.
FIGURES = ("tradeoff", "corrections", "stability", "scaling", "learning")

# Parts for those who look after a study: shown when they are opened.
FOLDED = ("quality", "stages", "training")
