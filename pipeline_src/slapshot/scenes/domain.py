"""The interface of a domain, and loading domains by name.

By default the stages simulate an arm with joint servos that strikes an object on a plane. A domain with
another kind of robot has its own modules in its folder, which replace those in `PARTS`.
"""

import ast
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from slapshot.config.scene import OwnScene, SceneSettings
from slapshot.config.trajectories import ScriptedHits
from slapshot.errors import InputError
from slapshot.own_code import import_own
from slapshot.store.code_dependencies import find_source
from slapshot.validation import validated, values_of

if TYPE_CHECKING:  # Snakemake's planning imports this module and must not need MuJoCo
    from slapshot.scenes.scene import Scene

# Part -> default module, for domains without their own. A domain's own is the file of that name in its
# folder.
PARTS = {
    "safety": "slapshot.trajectories.safety",  # class SafetyCheck
    "execution": "slapshot.trajectories.execution",  # function execute
    "collector": "slapshot.rollouts.collector",  # class Collector
    # Functions plain_rests and exact_rests, and LOOP, the name of the plain loop.
    "reference": "slapshot.rollouts.reference",
}


class Domain(Protocol):
    """A module with these functions, for example slapshot.domains.hockey.

    It may also define a class `SceneSettings`, the model of its block `scene`. Without one, all further keys
    of that block are attributes of the settings that `build_scene` receives.
    """

    def build_scene(self, settings: SceneSettings) -> "Scene":
        """Build the scene from the block `scene` of the domain's configuration."""

    def draw_task(self, settings: ScriptedHits, rng: np.random.Generator) -> dict[str, float]:
        """Draw the parameters of one scripted demonstration from the ranges of the block `demonstrations`."""

    def demonstrate(
        self, scene: "Scene", settings: ScriptedHits, tasks: list[dict[str, float]]
    ) -> list[NDArray[np.float64] | None]:
        """Waypoints (waypoints, joints) in rad for each task, None where it cannot be reached."""


def domain_module(name: str) -> str:
    """Dotted name of a domain's module; a name with a dot refers to a user's own module."""
    return name if "." in name else f"slapshot.domains.{name}"


def is_built_in(name: str) -> bool:
    """Whether a domain belongs to this package; any other is a user's own code."""
    return domain_module(name).startswith("slapshot.")


def find_domain(name: str) -> Path:
    """File of a domain's module, which is parsed but not imported.

    Raises:
        ValueError: there is no such module, or it is not a domain; the message reads `problem; remedy`.
    """
    module = domain_module(name)
    try:
        source = find_source(module)
    except (ImportError, ValueError):  # what Python itself has no file of
        source = None
    if source is None:
        raise ValueError(
            f"no domain {name!r}: no module {module}; use the name of a folder of slapshot.domains, or the "
            "dotted name of a module that can be imported"
        )
    functions = [function for function in vars(Domain) if function[0] != "_"]
    known = _top_level_names(source)
    missing = [function for function in functions if function not in known and "*" not in known]
    if missing:
        raise ValueError(
            f"{module} ({source}) is no domain, for it has no {' and no '.join(missing)}; name a module "
            "that has, such as hockey"
        )
    return source


def _top_level_names(source: Path) -> set[str]:
    """Names that a module defines or imports, including * for a star import.

    Raises:
        ValueError: the module is not valid Python.
    """
    try:
        tree = ast.parse(source.read_text("utf-8"))
    except (SyntaxError, ValueError) as error:  # ValueError: not a text file
        line, problem = getattr(error, "lineno", None) or 1, getattr(error, "msg", error)
        raise ValueError(f"{source}:{line}: not valid Python ({problem}); mend that line") from None
    names: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names


def load_domain(name: str, where: str = "scene.domain") -> Domain:
    """Import a domain; a user's own domain is announced first, because its code is executed.

    Args:
        name: folder of slapshot.domains, or dotted name of a module.
        where: file and key in which the name stands, for messages.

    Raises:
        InputError: there is no such module, it cannot be imported, or it is not a domain.
    """
    try:
        source = find_source(domain_module(name))
    except (ImportError, ValueError):  # what Python itself has no file of
        source = None
    if source is None or ("." not in name and source.name != "__init__.py"):
        raise InputError(
            f"{where}: no domain {name!r}; use a folder of slapshot.domains, or the dotted name "
            "of a module of your own that can be imported"
        )
    module = import_module(domain_module(name)) if is_built_in(name) else import_own(name, where)
    if not callable(getattr(module, "build_scene", None)):
        raise InputError(f"{where}: module {name} has no function build_scene; see slapshot.scenes.domain")
    return module


def scene_settings(domain: Domain) -> type[SceneSettings]:
    """The model of a domain's block `scene`."""
    found = getattr(domain, "SceneSettings", None)
    return found if isinstance(found, type) and issubclass(found, SceneSettings) else OwnScene


def build_scene(settings: SceneSettings) -> "Scene":
    """Build the scene of a block `scene`.

    Raises:
        InputError: its domain cannot be loaded, or rejects the settings.
    """
    domain = load_domain(settings.domain)
    return domain.build_scene(validated(scene_settings(domain), values_of(settings), "scene"))


def part_module(name: str, part: str) -> str:
    """Dotted name of the module of a domain's part: its own or the default."""
    own = f"{domain_module(name)}.{part}"
    return own if find_source(own) is not None else PARTS[part]


def load_part(name: str, part: str) -> ModuleType:
    """Import one of PARTS for the domain `name`."""
    return import_module(part_module(name, part))
