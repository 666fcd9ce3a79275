"""What the report can hold: each part a table, a figure or both, under its title, in the order of the page."""

PARTS = {
    "accuracy": "Accuracy",
    "better": "Accuracy against the better network",
    "planned": "Accuracy from the plan",
    "ablation": "Ablation",
    "claims": "The paper's claims",
    "regions": "Regions of the face",
    "landmarks": "Landmarks, skin and volume",
    "tradeoff": "Seconds against accuracy",
    "corrections": "Newton corrections after the network",
    "design": "Switches of the better network",
    "coverage": "Coverage of the intervals",
    "scene": "Models of what a plan requires",
    "stability": "Stability at the extremes",
    "training": "Training",
    "scaling": "Cost against nodes and patients",
    "stages": "Time of every stage",
    "quality": "Quality of the patients' models",
    "segments": "Registered motions of the bones",
}

# Parts with a figure.
FIGURES = ("tradeoff", "corrections", "stability", "scaling")
