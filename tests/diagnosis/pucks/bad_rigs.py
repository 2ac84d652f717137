"""Rig files that must be refused: made from good ones value by value, and written by hand."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import yaml

TABLE: dict[str, Any] = {
    "scene": {
        "domain": "table",
        "size_m": [0.26, 0.26, 0.23],
        "mass_kg": 0.4,
        "timestep_s": 0.001,
        "start_m": [0.5, 0.0],
        "table_m": [2.0, 2.0],
    },
    "friction": [0.2, 0.2, 0.02],
    "camera_m": [0.5, 0.5],
}
HOCKEY: dict[str, Any] = {
    "scene": {
        "domain": "hockey",
        "puck": "inline",
        "timestep_s": 0.0005,
        "start_m": [0.55, 0.0],
        "board_m": [3.0, 2.0],
    },
    "friction": [0.55, 0.55, 0.0255],
    "camera_m": [1.65, 0.0],
}
FETCHSLIDE: dict[str, Any] = {
    "scene": {"domain": "fetchslide"},
    "friction": [0.3, 0.3, 0.005],
    "camera_m": [1.3, 0.75],
}
GOOD = {"table": TABLE, "hockey": HOCKEY, "fetchslide": FETCHSLIDE}

_NAN, _INF = float("nan"), float("inf")
_NO_NUMBERS = (None, "much", "0.1", True, [], {"value": 1.0}, _NAN, _INF, -_INF, 1e300, -1e300, 10**30)
_NOT_POSITIVE = (0, 0.0, -1, -1e-9, 1e-300)
_NO_LISTS = (None, 3.0, "0.5, 0.0", {"x": 1.0}, [], True)
_NO_TEXTS = (None, 3, True, [], {}, "")
_MAY_BE_NEGATIVE = {"start_m", "camera_m"}


class Bad(NamedTuple):
    """A file, and the key that its one line must name."""

    name: str
    text: str
    key: str


def bad_rigs() -> list[Bad]:
    """All of them."""
    return [*_generated(), *_by_hand()]


def _generated() -> Iterator[Bad]:
    for name, good in GOOD.items():
        for loc, value in _values(good):
            for i, (wrong, key) in enumerate(_wrong(loc, value)):
                changed = deepcopy(good)
                _at(changed, loc[:-1])[loc[-1]] = wrong
                yield Bad(f"{name}: {_key(loc)} {i}", yaml.safe_dump(changed), key)
            if isinstance(loc[-1], str):
                changed = deepcopy(good)
                del _at(changed, loc[:-1])[loc[-1]]
                yield Bad(f"{name}: without {_key(loc)}", yaml.safe_dump(changed), _key(loc[:-1]))
        for loc in ((), ("scene",)):
            changed = deepcopy(good)
            _at(changed, loc)["colour"] = "red"
            yield Bad(f"{name}: {_key(loc)} unknown", yaml.safe_dump(changed), _key((*loc, "colour")))


def _wrong(loc: tuple[Any, ...], value: Any) -> Iterator[tuple[Any, str]]:
    """Values that are wrong in that place, and the key that must be named."""
    own = _key(loc)
    if isinstance(value, Mapping):
        yield from ((wrong, own) for wrong in (None, 3, "table", [value], True))
        yield {}, own
    elif isinstance(value, list):
        yield from ((wrong, own) for wrong in _NO_LISTS)
        yield value[:-1], own
        yield [*value, 1.0], own
    elif isinstance(value, str):
        yield from ((wrong, own) for wrong in (*_NO_TEXTS, "nowhere", "tab\x00le", value * 100))
    else:
        yield from ((wrong, own) for wrong in _NO_NUMBERS)
        if not _MAY_BE_NEGATIVE & set(loc):
            yield from ((wrong, own) for wrong in _NOT_POSITIVE)


def _values(of: Any, loc: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    inside = of.items() if isinstance(of, Mapping) else enumerate(of) if isinstance(of, list) else ()
    for key, value in inside:
        yield (*loc, key), value
        yield from _values(value, (*loc, key))


def _at(values: Any, loc: tuple[Any, ...]) -> Any:
    for part in loc:
        values = values[part]
    return values


def _key(loc: tuple[Any, ...]) -> str:
    return ".".join(map(str, loc)) or "top level"


def _text(good: Mapping[str, Any], **changes: Any) -> str:
    """A good rig with other values of its scene, or of the file where that has the key."""
    changed = deepcopy(dict(good))
    for key, value in changes.items():
        (changed if key in (*good, "effects") else changed["scene"])[key] = value
    return yaml.safe_dump(changed)


def _by_hand() -> Iterator[Bad]:
    """What a person gets wrong, and what a stranger tries."""
    for name in (
        *(
            "Table",
            "tables",
            "table ",
            " ",
            "-rf",
            "../table",
            "domains/table",
            "table.py",
            ".",
            "..",
            "a..b",
        ),
        *("domain", "scene", "settings", "striker", "randomisation", "__main__", "__init__", "slapshot"),
        *(
            "os.path",
            "slapshot.cli",
            "slapshot.scenes",
            "no_such_package.domain",
            "table\nhockey",
            "t\u00e4ble",
        ),
    ):
        yield Bad(f"domain {name!r}", _text(TABLE, domain=name), "scene.domain")
    yield Bad("domain alone", "scene: {domain: table}\nfriction: [1, 1, 0.1]\ncamera_m: [0, 0]\n", "scene")
    for name, key, changes in (
        ("step that does not divide", "scene.timestep_s", {"timestep_s": 0.0003}),
        ("step of 2 ms", "scene.timestep_s", {"timestep_s": 0.002}),
        ("step of a nanosecond", "scene.timestep_s", {"timestep_s": 1e-9}),
        ("step in ms", "scene.timestep_s", {"timestep_s": 1}),
        ("mass in g", "scene", {"mass_kg": 400}),
        ("mass of a mote", "scene", {"mass_kg": 0.001}),
        ("heavier than a lorry", "scene.mass_kg", {"mass_kg": 20000}),
        ("edges in mm", "scene.size_m.0", {"size_m": [260, 260, 230]}),
        ("edge of a hair", "scene.size_m.2", {"size_m": [0.26, 0.26, 0.00005]}),
        ("flat box of 0.4 kg", "scene", {"size_m": [0.001, 0.001, 0.001]}),
        ("start in the next town", "scene.start_m.0", {"start_m": [5000.0, 0.0]}),
        ("table of nothing", "scene.table_m.1", {"table_m": [2.0, 0.0]}),
        ("negative table", "scene.table_m.0", {"table_m": [-2.0, -2.0]}),
        ("table of a kilometre", "scene.table_m.0", {"table_m": [1000.0, 2.0]}),
        ("puck on a table", "scene.puck", {"puck": "ice"}),
        ("friction in percent", "friction.0", {"friction": [20, 20, 0.02]}),
        ("torsional friction in mm", "friction.2", {"friction": [0.2, 0.2, 20.0]}),
        ("torsional friction in cm", "friction.2", {"friction": [0.2, 0.2, 2.0]}),
        ("no friction", "friction.1", {"friction": [0.2, 0.0, 0.02]}),
        ("friction by name", "friction", {"friction": {"x": 0.2, "y": 0.2}}),
        ("camera in mm", "camera_m.0", {"camera_m": [500, 500]}),
        ("camera with a height", "camera_m", {"camera_m": [0.5, 0.5, 3.0]}),
        ("effects as one text", "effects", {"effects": "my_effect"}),
        ("effects as nothing", "effects", {"effects": None}),
        ("effects as a mapping", "effects", {"effects": {"my_effect": True}}),
        ("effect that is a number", "effects.0", {"effects": [3]}),
        ("effect that is empty", "effects.0", {"effects": [""]}),
        ("effect that is a path", "effects.0", {"effects": ["my/effect.py"]}),
        ("effect with a blank", "effects.1", {"effects": ["slapshot.effects.tilt", "my effect"]}),
        ("relative effect", "effects.0", {"effects": [".tilt"]}),
        ("effect with an option", "effects.0", {"effects": ["-c"]}),
        ("effect of 5,000 letters", "effects.0", {"effects": ["a" * 5000]}),
        ("effect with an escape", "effects.0", {"effects": ["a\x1b[31m"]}),
    ):
        yield Bad(name, _text(TABLE, **changes), key)
    for name, key, changes in (
        ("puck in the arm's foot", "scene.start_m", {"start_m": [0.0, 0.0]}),
        ("puck out of reach", "scene.start_m", {"start_m": [2.0, 0.0]}),
        ("no such puck", "scene.puck", {"puck": "street"}),
        ("Puck", "scene.puck", {"puck": "Ice"}),
        ("size of a puck", "scene.size_m", {"size_m": [0.1, 0.1, 0.1]}),
        ("no whiteboard", "scene.board_m.0", {"board_m": [0, 0]}),
    ):
        yield Bad(name, _text(HOCKEY, **changes), key)
    yield Bad("FetchSlide with a step", _text(FETCHSLIDE, timestep_s=0.001), "scene.timestep_s")
    good = yaml.safe_dump(TABLE)
    yield Bad(
        "twice a key",
        good + "friction: [0.2, 0.2, 0.02]\n",
        "not valid YAML (key 'friction' stands there twice)",
    )
    for name, text in (
        ("nothing", ""),
        ("a comment", "# a rig\n"),
        ("a text", "table\n"),
        ("a list", "- scene\n- friction\n"),
        ("a number", "3\n"),
        ("two documents", good + "---\n" + good),
        ("an open bracket", good + "notes: [1, 2\n"),
        ("a tab", "scene:\n\tdomain: table\n"),
        ("Python", good + "notes: !!python/object/apply:os.system ['true']\n"),
        ("an unknown alias", good + "notes: *nobody\n"),
        ("an alias in itself", good + "notes: &a [*a]\n"),
        ("brackets without end", "scene: " + "[" * 5000 + "\n"),
        ("a merge of nothing", good + "<<: 3\n"),
        ("a null byte", good + "notes: 'a\x00b'\n"),
        ("a date", good.replace("mass_kg: 0.4", "mass_kg: 2024-01-01")),
        ("a month that is none", good.replace("mass_kg: 0.4", "mass_kg: 2024-13-01")),
        ("a key that is a number", good + "3: 4\n"),
        ("a key that is a list", good + "? [1, 2]\n: 3\n"),
        ("octal", good.replace("mass_kg: 0.4", "mass_kg: 0o17")),
        ("an exponent without a point", good.replace("mass_kg: 0.4", "mass_kg: 4e-1")),
        ("a comma", good.replace("mass_kg: 0.4", "mass_kg: 0,4")),
        ("a unit", good.replace("mass_kg: 0.4", "mass_kg: 0.4 kg")),
        ("a number of 5,000 digits", good.replace("mass_kg: 0.4", "mass_kg: " + "9" * 5000)),
    ):
        yield Bad(name, text, "")


_EFFECT = """
from slapshot.effects.effect import Effect, Parameter


class Own(Effect):
    name = "own_wind"
    phase = "slide"
    follows = "heading"
    parameters = (Parameter("push", "m/s^2", -5.0, 5.0, 0.1, "towards +y"),)
    physics = "A steady wind."
    source = "made up for a test"

    def accelerate(self, values, state):
        return 0 * values["push"], values["push"]
"""


def effect(old: str = "", new: str = "") -> str:
    """Source of a module with a working effect, in which `old` is replaced."""
    assert old in _EFFECT
    return _EFFECT.replace(old, new) if old else _EFFECT


def _refusal(source: str) -> str:
    """What this Python calls a source's error: a null byte is a ValueError in 3.11.2, later a SyntaxError."""
    try:
        compile(source, "source", "exec")
    except (SyntaxError, ValueError) as error:
        return type(error).__name__
    raise AssertionError("this can be compiled")


_PARAMETER = '("push", "m/s^2", -5.0, 5.0, 0.1, "towards +y")'
_BODY = '        return 0 * values["push"], values["push"]'
# What is wrong with a module that a rig file names -> its source, and what its one line says.
BAD_MODULES: dict[str, tuple[str, str]] = {
    "raises": ("x = 1\nraise ValueError('bad\\nday')\n", "own_module.py:2): ValueError: bad day; mend it"),
    "raises what has no text": ("raise RuntimeError\n", "own_module.py:1): RuntimeError; mend it"),
    "raises an escape": ("raise ValueError('\\x1b[31m')\n", "ValueError: \\x1b[31m; mend it"),
    "raises what cannot be said": (
        "class Mute(Exception):\n    def __str__(self):\n        raise ValueError\n\n\nraise Mute\n",
        "own_module.py:6): Mute; mend it",
    ),
    "raises at length": ("raise ValueError('a' * 100_000)\n", "ValueError: aaa"),
    "interrupts": ("raise KeyboardInterrupt\n", "own_module.py:1): KeyboardInterrupt; mend it"),
    "ends": ("import sys\n\nsys.exit(0)\n", "own_module.py:3): it calls sys.exit; mend it"),
    "ends with a text": ("raise SystemExit('done')\n", "own_module.py:1): it calls sys.exit; mend it"),
    "is no Python": ("def f(:\n    pass\n", "own_module.py:1: SyntaxError"),
    "has tabs": ("if True:\n\tx = 1\n        y = 2\n", "own_module.py:3: TabError"),
    "has a null byte": ("x = 1\0\n", f"own_module: {_refusal(chr(0))}"),
    "imports what is not there": (
        "import no_such_package\n",
        "ModuleNotFoundError: No module named 'no_such_package'",
    ),
    "imports itself without end": ("def f():\n    f()\n\n\nf()\n", "own_module.py:2): RecursionError"),
    "is empty": ("", "module own_module defines no Effect; derive one"),
    "imports an effect": (
        "from slapshot.effects.tilt import Tilt\n",
        "module own_module defines no Effect; derive one",
    ),
    "has an effect that is none": ("class Effect:\n    name = 'mine'\n", "defines no Effect; derive one"),
    "needs an argument": (
        effect("    name =", "    def __init__(self, x):\n        pass\n\n    name ="),
        "TypeError",
    ),
    "raises when made": (
        effect("    name =", "    def __init__(self):\n        raise OSError('no')\n\n    name ="),
        "own_module.py:7): OSError: no; mend it",
    ),
    "ends when made": (
        effect("    name =", "    def __init__(self):\n        raise SystemExit\n\n    name ="),
        "own_module.py:7): it calls sys.exit; mend it",
    ),
    "raises when asked": (
        effect(
            '    physics = "A steady wind."',
            "    @property\n    def physics(self):\n        raise OSError('no')",
        ),
        "OSError: no; mend it",
    ),
    "is called as another": (effect("own_wind", "tilt"), "two effects are called 'tilt'"),
    "is called as a free form": (effect("own_wind", "free_place"), "names that begin with free_ are taken"),
    "has no name": (effect('    name = "own_wind"\n'), "top level: key 'name' is missing"),
    "has a number for a name": (effect('"own_wind"', "3"), "name: 3 is not a text"),
    "has a path for a name": (effect("own_wind", "../own"), "name: '../own' is not allowed"),
    "has a forged name": (
        effect("own_wind", "wind\\n# Nothing"),
        "name: 'wind\\n# Nothing' is not allowed",
    ),
    "has a long name": (effect("own_wind", "w" * 65), "is not allowed; use letters"),
    "has no such phase": (
        effect('"slide"', '"flight"'),
        "phase: 'flight' is not allowed; use one of: swing, contact",
    ),
    "has no phase": (effect('    phase = "slide"\n'), "key 'phase' is missing"),
    "follows nothing": (
        effect('"heading"', '"the moon"'),
        "follows: 'the moon' is not allowed; use one of: place",
    ),
    "has no parameter": (effect(f"(Parameter{_PARAMETER},)", "()"), "parameters: [] has 0 values"),
    "has no parameters": (
        effect(f"    parameters = (Parameter{_PARAMETER},)\n"),
        "key 'parameters' is missing",
    ),
    "has one that is none": (
        effect(f"Parameter{_PARAMETER}", "'push'"),
        "parameters.0: 'push' is not a mapping",
    ),
    "has a bare one": (effect(f"(Parameter{_PARAMETER},)", f"Parameter{_PARAMETER}"), "parameters: "),
    "has two of a name": (
        effect(f"(Parameter{_PARAMETER},)", f"(Parameter{_PARAMETER}, Parameter{_PARAMETER})"),
        "two parameters are called 'push'",
    ),
    "has bounds the wrong way": (
        effect("-5.0, 5.0", "5.0, -5.0"),
        "parameters.0: low 5 is not below high -5",
    ),
    "has bounds without end": (
        effect("5.0, 0.1", "float('inf'), 0.1"),
        "parameters.0.high: inf is not a finite",
    ),
    "has a bound that is none": (
        effect("5.0, 0.1", "float('nan'), 0.1"),
        "parameters.0.high: nan is not a finite",
    ),
    "has a text for a bound": (effect("5.0, 0.1", "'5', 0.1"), "parameters.0.high: '5' is not a number"),
    "has no scale": (
        effect("5.0, 0.1", "5.0, 0.0"),
        "parameters.0.scale: 0.0 is out of range; it must be > 0",
    ),
    "has a scale beyond its bounds": (effect("5.0, 0.1", "5.0, 11.0"), "parameters.0: scale 11 is more than"),
    "is neutral out of bounds": (
        effect("-5.0, 5.0", "1.0, 5.0"),
        "neutral 0 is not within 1 to 5; correct it",
    ),
    "has no unit": (effect('"m/s^2"', '""'), "parameters.0.unit: '' is empty"),
    "has no physics": (effect('"A steady wind."', "None"), "physics: None is not a text"),
}
# What an effect does that works when it is tried and no more -> what the one line says.
FAILS_LATER = {
    "raise SystemExit(0)": "it calls sys.exit; mend it, or do without that module",
    "raise KeyError('wind')": "KeyError: 'wind'; mend it, or do without that module",
}


def failing_later(statement: str) -> str:
    """Source of an effect that does so with more than the five hits that effects are tried with."""
    return effect(_BODY, f"        if len(state.x) > 5:\n            {statement}\n{_BODY}")
