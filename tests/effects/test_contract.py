"""What holds for every effect, those of one's own included."""

import math
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hitting import Swing, arm_swing, execute, push, slid
from slapshot.effects import catalogue as catalogue_module
from slapshot.effects.catalogue import catalogue, import_effects, named
from slapshot.effects.effect import Effect, Phase
from slapshot.effects.table import as_markdown
from slapshot.errors import InputError

EFFECTS = list(catalogue().values())
LAUNCHES = [[0.55, 0.0, 0.0, 1.2, 0.5, 4.0], [0.55, 0.1, 0.3, 0.7, -0.6, -9.0]]
ORDER = [-0.5, 0.5]
CAMERA = np.array([1.3, 0.1])

each = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)


@pytest.fixture(scope="module")
def swings(scene) -> list[Swing]:
    """Of an arm with joints that turn, and of a cart on rails; both hit."""
    return [arm_swing(scene), push()]


@pytest.fixture
def own_effect(tmp_path, monkeypatch) -> Effect:
    """An effect from outside the package: a wind along y."""
    (tmp_path / "side_wind.py").write_text(
        "from slapshot.effects.effect import Effect, Parameter\n\n\n"
        "class SideWind(Effect):\n"
        "    name = 'side_wind'\n"
        "    phase = 'slide'\n"
        "    follows = 'heading'\n"
        "    parameters = (Parameter('push', 'm/s^2', -5.0, 5.0, 0.1, 'towards +y'),)\n"
        "    physics = 'A steady wind.\\nIt pushes alike everywhere.'\n"
        "    source = 'made up for a test'\n\n"
        "    def accelerate(self, values, state):\n"
        "        return 0 * values['push'], values['push']\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(catalogue_module, "_registered", dict(catalogue()))
    import_effects("side_wind")
    yield catalogue()["side_wind"]
    del sys.modules["side_wind"]


def plain(effect: Effect) -> dict[str, float]:
    """Parameters a plain case away from neutral, but for every third: equal bumps make a level board."""
    return {
        p.name: p.neutral if j % 3 == 2 else min(p.neutral + p.scale, p.high)
        for j, p in enumerate(effect.parameters)
    }


def camera_values(effect: Effect, values: dict[str, float], hits: int) -> dict[str, np.ndarray]:
    return {name: np.full(hits, value) for name, value in values.items()}


def check_description(effect: Effect) -> None:
    for p in effect.parameters:
        assert all(math.isfinite(x) for x in (p.low, p.neutral, p.high, p.scale)), p
        assert p.low <= p.neutral <= p.high, p
        assert p.low < p.high, p
        assert 0 < p.scale <= p.high - p.low, p
        assert p.unit, p
        assert p.meaning, p
    names = [p.name for p in effect.parameters]
    assert names
    assert len(set(names)) == len(names)
    lines = effect.physics.split("\n")
    assert len(lines) == 2
    assert all(line.strip() for line in lines)
    assert effect.source


def check_neutral(effect: Effect, swings: list[Swing]) -> None:
    if effect.acts_on_launch:
        for swing in swings:
            neutral, nominal = execute(swing, effect), execute(swing)
            for field in ("arm", "object", "velocity"):
                assert np.array_equal(getattr(neutral, field), getattr(nominal, field)), field
    if effect.acts_on_slide:
        neutral, nominal = slid(effect, LAUNCHES, order=ORDER), slid(None, LAUNCHES, order=ORDER)
        assert neutral.places == pytest.approx(nominal.places, abs=1e-9)
        assert neutral.rests == pytest.approx(nominal.rests, abs=1e-9)
    if effect.acts_on_camera:
        places = np.random.default_rng(0).normal(size=(2, 5, 2))
        values = camera_values(effect, effect.neutral(), 2)
        assert effect.see(values, places, CAMERA) == pytest.approx(places, abs=1e-12)
        delay = effect.camera_delay(values)
        assert delay is None or not np.any(delay)


def check_that_it_acts(effect: Effect, swings: list[Swing]) -> None:
    """A plain case changes something, all is finite, and names that others rely on stay."""
    values = plain(effect)
    changed = False
    if effect.acts_on_launch:
        for swing in swings:
            acted, nominal = execute(swing, effect, **values), execute(swing)
            assert np.isfinite(acted.velocity).all()
            check_names(acted.model, swing)
            changed |= not np.array_equal(acted.velocity, nominal.velocity)
    if effect.acts_on_slide:
        acted, nominal = slid(effect, LAUNCHES, order=ORDER, **values), slid(None, LAUNCHES, order=ORDER)
        assert np.isfinite(acted.places).all()
        changed |= np.abs(acted.rests - nominal.rests).max() > 1e-3
    if effect.acts_on_camera:
        places = np.random.default_rng(0).normal(size=(2, 5, 2))
        seen = effect.see(camera_values(effect, values, 2), places, CAMERA)
        assert seen.shape == places.shape
        changed |= np.abs(seen - places).max() > 1e-3 or effect.camera_delay(values) is not None
    assert changed


def check_names(model: mujoco.MjModel, swing: Swing) -> None:
    info, nominal = swing.scene.info, swing.scene.compile()
    for joint in (*info.joints, *info.object_joints):
        assert model.joint(joint).type == nominal.joint(joint).type
    for name in (info.object_pair, info.striker_pair):
        first, second = (model.pair(name).geom1[0], model.pair(name).geom2[0])
        expected = (nominal.pair(name).geom1[0], nominal.pair(name).geom2[0])
        assert [model.geom(i).name for i in (first, second)] == [nominal.geom(i).name for i in expected]
    assert [model.actuator(i).name for i in range(model.nu)] == [
        nominal.actuator(i).name for i in range(nominal.nu)
    ]
    assert model.site(info.striker_site).name
    for geom in info.clearance_geoms:
        assert model.geom(geom).name
    assert model.body_mass.sum() == pytest.approx(nominal.body_mass.sum(), rel=1e-12)


def check_phase(effect: Effect) -> None:
    where = {
        "launch": effect.acts_on_launch,
        "slide": effect.acts_on_slide,
        "camera": effect.acts_on_camera,
    }
    must: dict[Phase, str] = {
        "swing": "launch",
        "contact": "launch",
        "slide": "slide",
        "across hits": "slide",
        "camera": "camera",
    }
    assert where.pop(must[effect.phase])
    if effect.phase in ("swing", "contact"):
        hooks = {"edit", "command"} if effect.phase == "swing" else {"edit"}
        assert any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in hooks)
    # A property of the object may show in the launch, too; nothing else acts at two places.
    assert not any(acts for place, acts in where.items() if (effect.phase, place) != ("slide", "launch"))


@each
def test_it_describes_itself(effect):
    check_description(effect)


@each
def test_it_has_the_name_of_its_file_and_says_what_file_that_is(effect):
    module = sys.modules[type(effect).__module__]
    assert Path(module.__file__).stem == effect.name
    assert catalogue()[effect.name] is effect
    assert module.__doc__.lower().startswith(effect.name.replace("_", " ").replace("offcentre", "off-centre"))


@each
def test_it_acts_where_its_phase_says(effect):
    check_phase(effect)


@each
def test_at_its_neutral_value_the_simulation_is_the_nominal_one(effect, swings):
    check_neutral(effect, swings)


@each
def test_a_plain_case_changes_the_outcome_and_keeps_names_and_masses(effect, swings):
    check_that_it_acts(effect, swings)


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.acts_on_launch], ids=lambda effect: effect.name)
@pytest.mark.parametrize("side", ["low", "almost neutral", "high"])
def test_no_value_within_bounds_makes_the_simulation_unstable(effect, side, swings):
    values = {
        p.name: p.neutral + 1e-6 * p.scale if side == "almost neutral" else getattr(p, side)
        for p in effect.parameters
    }
    for swing in swings:
        course = execute(swing, effect, **values)
        assert np.isfinite(course.velocity).all()
        assert np.abs(course.velocity[:, :2]).max() < 5.0
        if side == "almost neutral":
            # Stiff springs answer a step late, which a step of 0.5 ms shows: the error ends with the step.
            nominal = execute(swing).velocity[:, :2].max()
            assert course.velocity[:, :2].max() == pytest.approx(nominal, rel=0.05)


def test_all_launch_effects_can_act_at_once(swings):
    effects = [effect for effect in EFFECTS if effect.acts_on_launch]
    for order in (effects, effects[::-1]):
        spec = mujoco.MjSpec.from_string(swings[0].scene.xml)
        for effect in order:
            effect.edit(plain(effect), spec, swings[0].scene.info)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        assert np.isfinite(data.qpos).all()


def test_an_effect_of_ones_own_is_in_the_catalogue_and_keeps_the_contract(own_effect, swings):
    assert named(["side_wind"]) == [own_effect]
    check_description(own_effect)
    check_phase(own_effect)
    check_neutral(own_effect, swings)
    check_that_it_acts(own_effect, swings)
    assert "| `side_wind` | slide | heading | `push`: towards +y (0; -5 to 5; 0.1 m/s^2) |" in as_markdown()


def test_two_effects_of_one_name_are_refused(own_effect):
    other = type("Other", (type(own_effect),), {})
    with pytest.raises(InputError, match="two effects are called 'side_wind'"):
        catalogue_module.register(other())


def test_the_table_has_a_row_for_every_effect():
    done = subprocess.run(
        [sys.executable, "-m", "slapshot.effects"], capture_output=True, text=True, check=True
    )
    assert done.stdout == as_markdown()
    lines = done.stdout.splitlines()
    columns = lines[0].count(" | ")
    assert [line.split("|")[1].strip(" `") for line in lines[2:]] == list(catalogue())
    assert {line.count(" | ") for line in lines if "---" not in line} == {columns}
    assert "`height_0` to `height_168`" in done.stdout


def test_the_table_in_the_documentation_is_that_of_the_code():
    """Made by `python -m slapshot.effects`; effects that tests register are no part of it."""
    command = [sys.executable, "-m", "slapshot.effects"]
    made = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    text = (Path(catalogue_module.__file__).parent / "README.md").read_text()
    assert text[text.index("| effect |") :] == made


def test_the_table_of_joint_effects_is_that_of_the_code():
    """Made by `python -m slapshot.effects joints`."""
    command = [sys.executable, "-m", "slapshot.effects", "joints"]
    made = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    text = (Path(__file__).parents[2] / "docs/effects.md").read_text()
    assert text[text.index("| effect |") :] == made
