"""Classes and functions that are named by a string, e.g. pinnochio.methods.elastic:ElasticPredictor."""

from importlib import import_module


def resolve(reference: str):
    """What a reference `module:name` names."""
    module, name = reference.split(":")
    return getattr(import_module(module), name)
