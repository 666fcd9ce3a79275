"""What seconds of a plan buy: the setting that comes nearest to the converged field, in seconds of this machine."""

import os
from dataclasses import dataclass

from pinnochio.code import ROOT
from pinnochio.errors import InputError
from pinnochio.json_text import read_stored_json
from pinnochio.mechanics.settings import FemSettings
from pinnochio.mechanics.simulation import Simulator
from pinnochio.model.patient import PatientModel
from pinnochio.plans.plan import Plan
from pinnochio.timing import repeated

FRONT = ROOT / "models/front.json"  # comes with the models, made by tests/benchmarks/accuracy.py
MESH = 1.5  # times as many nodes as those that the front was measured on, or as few, still take its multiples


@dataclass(frozen=True)
class Expected:
    """A method, its fem.accuracy (mm, or empty), how far from the converged field the worst point of the face is on
    95 of 100 plans (mm), and all that is expected in words."""

    method: str
    accuracy: float | str
    mm: float
    words: str


def within(
    seconds: float, patient: PatientModel, plan: Plan, fem: FemSettings, front: str | os.PathLike = FRONT
) -> Expected:
    """The setting of the front nearest to the converged field of those that take so many seconds on 95 of 100 plans.

    Seconds are multiples of those of the patient's linear field under the plan, which is solved here and now. None of
    the front's settings is nearer than a faster one by less than the standard error of that. InputError where even the
    fastest takes longer, or the mesh is of another size than the front's.
    """
    read, nodes = read_stored_json(front), len(patient.points)
    if not 1 / MESH < nodes / read["nodes"] < MESH:
        problem = f"predict.seconds knows meshes of about {read['nodes']} nodes, and this one has {nodes}"
        raise InputError(plan.case, front, problem, "give predict.accuracy in its place, or the usual mesh.nodes")
    with Simulator(patient, fem, linear=True) as simulator:
        simulator.solve([plan])  # makes the factors, and loads compiled code
        linear = repeated(lambda: simulator.solve([plan]))[1]
    settings = [one for one in read["settings"] if one["front"]]
    fits = [one for one in settings if one["times_95"] * linear <= seconds]
    if not fits:
        fastest = settings[0]
        least = fastest["times_95"] * linear
        problem = f"predict.seconds is {seconds:g}, and {fastest['method']}, the fastest, takes {least:.2g} here"
        raise InputError(plan.case, "configuration", problem, "give it more, or predict.accuracy in its place")
    best = min(fits, key=lambda one: one["mm"])
    name = best["method"] + (f", accuracy {best['accuracy']}," if best["accuracy"] else "")
    words = (
        f"{plan.case}: {name} in {best['times'] * linear:.2g} s ({seconds:g} wished), at the worst point of the face "
        f"{best['mm']:.2g} mm from the converged field in the mean, {best['mm_95']:.2g} on 5 of 100 plans"
    )
    return Expected(best["method"], best["accuracy"], best["mm_95"], words)
