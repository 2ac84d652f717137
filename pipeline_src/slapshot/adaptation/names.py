"""Names of adaptation methods; apart from `method.py`, so that the plan need not import torch."""


def method_file(name: str) -> str:
    """Return the file of this package, without .py, that a method's name in the configuration means.

    One file can serve several methods that differ in their settings: what follows the first
    underscore tells them apart (`maml_1` and `maml_8` are both maml.py).
    """
    return name.partition("_")[0]
