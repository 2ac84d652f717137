"""Names of adaptation methods; separate from `method.py`, so that `slapshot.dag` need not import torch."""

PART = "part/"  # with which roles of ensembles begin that are put together


def method_file(name: str) -> str:
    """Return the file of this package, without .py, that implements a method of the configuration.

    One file can serve several methods that differ in their settings: the part of the name after the
    first underscore distinguishes them (`maml_1` and `maml_8` are both maml.py).
    """
    return name.partition("_")[0]
