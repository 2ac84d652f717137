"""What is missing? Effects are added one at a time, by refits, until nothing more can be told.

Columns screen, refits decide. Where no law of the present state explains what is left, models with a state of
their own are tried (a spring or play in a joint), by shooting. Free forms never make a name: where one
explains what names do not, something is missing that the catalogue does not have.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from slapshot.arrays import Array
from slapshot.diagnosis.filter import innovations
from slapshot.diagnosis.fit import Fit
from slapshot.diagnosis.free_forms import is_free
from slapshot.diagnosis.hypothesis import Hypothesis
from slapshot.diagnosis.inference.null import DRAWS, MismatchTest, mismatch_test
from slapshot.diagnosis.inference.scores import scores, spread_over_information
from slapshot.diagnosis.inference.selection import gains
from slapshot.diagnosis.law_error import SLOW
from slapshot.diagnosis.noise import LARGEST_LAW_ERROR, Noise, fit_noise, fit_process_force
from slapshot.diagnosis.problem import Examination, Problem, examine, first_look
from slapshot.diagnosis.pulses import pushes
from slapshot.diagnosis.shooting import shoot, simulate
from slapshot.effects.joints.effect import JointEffect
from slapshot.effects.joints.external_pulse import ExternalPulse

P_VALUE = 0.01
MOST_EFFECTS = 5
_LARGE_LAW_ERROR = 0.01  # where all shapes of errors of laws are looked at
_MARGIN = 2.0  # over the error that laws were found to have, when columns of them are chosen
REFITTED = 6  # candidates that are refitted in a step
_RACE_NODES, _RACE_ROUNDS = 2000, 4  # of a first refit
_AGAIN = 4  # rounds under the process force of its own
_BEHIND, _BEHIND_NATS = 0.02, 30.0  # behind the leader, where no candidate is refitted to everything
CLASS_NATS = float(np.log(20.0))  # rivals within a factor of twenty cannot be told apart
_STRUCTURE_JOINTS = 3
_STRUCTURE_STEPS = 2  # in which structures are tried: alone, and beside the law that gained most
_TRIAL_ROUNDS, _SHOT_SEGMENTS = 6, 12  # for a first look at structures
_SPREAD, _LEAST_SPREAD = 3.0, 1e-8  # rms of a hidden motion that a first state may lie off; of its variance
_SHOT_BEHIND = 20.0  # nats behind the law there, where no structure is followed further

Report = Callable[[str], None]


@dataclass(frozen=True)
class Rival:
    """An effect that was refitted in a step, and by how many nats it gained."""

    effect: JointEffect
    gain: float
    fit: Fit

    @property
    def idle(self) -> bool:
        """Whether the effect does nothing."""
        return idle(self.effect, self.fit)


def idle(effect: JointEffect, fit: Fit) -> bool:
    """Whether the last effect of a fit does nothing: all its sizes, which cannot be negative, are 0."""
    own = fit.theta[len(fit.theta) - len(effect.parameters) :]
    sizes = [(value, p) for value, p in zip(own, effect.parameters, strict=True) if p.low == p.start == 0]
    return bool(sizes) and all(value <= 1e-9 * p.scale for value, p in sizes)


@dataclass(frozen=True)
class Step:
    """One step of the search.

    Attributes:
        problem: which may be restructured.
        examination: of the hypothesis at the end of the step.
        test: whether something is missing in it.
        added: effect that was added; None at first.
        gain: nats that it gained.
        rivals: refitted in this step, best first.
    """

    problem: Problem
    examination: Examination
    test: MismatchTest
    added: JointEffect | None = None
    gain: float = 0.0
    rivals: tuple[Rival, ...] = ()

    @property
    def hypothesis(self) -> Hypothesis:
        """What is in the model."""
        return self.examination.fit.hypothesis


@dataclass(frozen=True)
class Search:
    """All steps; the first is the nominal rig with its free parameters."""

    steps: tuple[Step, ...]
    free: tuple[JointEffect, ...]

    @property
    def nominal(self) -> Step:
        """The first."""
        return self.steps[0]

    @property
    def final(self) -> Step:
        """The last."""
        return self.steps[-1]

    @property
    def named(self) -> tuple[JointEffect, ...]:
        """Effects that were added and stayed."""
        free = {effect.key for effect in self.free}
        return tuple(e for e in self.final.hypothesis.effects if e.key not in free)

    def before(self, effect: JointEffect | None) -> "Search":
        """The same as it stood before an effect was added."""
        since = next((i for i, step in enumerate(self.steps) if step.added is effect), len(self.steps))
        return replace(self, steps=self.steps[:since])

    def since(self, effect: JointEffect | None) -> list[str]:
        """Keys of an effect and of those that were added after it."""
        later = self.steps[len(self.before(effect).steps) :]
        return list(dict.fromkeys(step.added.key for step in later if step.added is not None))


def search(problem: Problem, free: Sequence[JointEffect], seed: int, report: Report) -> Search:
    """Look for what is missing.

    Args:
        problem: segments that may be used.
        free: effects of the nominal rig itself.
        seed: of the draws behind p-values.
        report: told what is being done.
    """
    rng = np.random.default_rng(seed)
    report("fitting the nominal model")
    steps = [nominal_step(problem, free, rng)]
    if not steps[0].examination.fit.settled:
        return Search(tuple(steps), tuple(free))
    while steps[-1].test.p_value < P_VALUE and len(steps) <= MOST_EFFECTS:
        try:
            before = steps[-1]
            step = _extended(before, rng, report)
            law = before if step is None else step
            split = any(effect.hidden_state for effect in before.hypothesis.effects)
            if len(steps) <= _STRUCTURE_STEPS and not split and law.test.p_value < P_VALUE:
                step = _structured(before, law, rng, report) or step
            if step is None:
                break
            steps.append(step)
        except np.linalg.LinAlgError:
            # What was found so far stands, and its test says that something is left.
            report("a refit diverges: the search ends")
            break
    final = _pruned(steps[-1], free, rng, report)
    if final is not steps[-1]:
        steps.append(final)
    return Search(tuple(steps), tuple(free))


def nominal_step(problem: Problem, free: Sequence[JointEffect], rng: np.random.Generator) -> Step:
    """The nominal rig with its free parameters, fitted and tested."""
    base = problem.base(free)
    problem, fit, noise = first_look(problem, base)
    examined = examine(problem, base, fit.theta, fit.path, noise, near=False)
    if examined.noise.law_error <= _LARGE_LAW_ERROR:
        return Step(problem, examined, _test(examined, rng))
    fine = problem.along(examined.fit.path, fine=True)
    examined = examine(fine, base, examined.fit.theta, examined.fit.path, examined.noise)
    step = Step(fine, examined, _test(examined, rng))
    if step.test.p_value >= P_VALUE:
        return step
    # Refits take long with all shapes: from here those serve that matter.
    law_error = examined.noise.law_error
    return _with(step, problem if law_error <= _LARGE_LAW_ERROR else fine.with_law_error(_MARGIN * law_error))


def _with(step: Step, problem: Problem) -> Step:
    """The step's hypothesis and test, fitted to a problem with other errors of laws."""
    fit, left, interval = step.examination.fit, step.examination.left, problem.segments.interval
    system, prior = problem.fitter.system(fit.hypothesis, fit.theta, fit.path)
    left = fit_process_force(system, prior, left, interval)
    fit = problem.fitter.fit(fit.hypothesis, fit.theta, fit.path, left, known=system)
    return replace(step, problem=problem, examination=replace(step.examination, fit=fit, left=left))


def _test(examined: Examination, rng: np.random.Generator) -> MismatchTest:
    """Of all groups of columns and of pushes; the smaller p-value of two independent ones, made one again."""
    found = mismatch_test(examined.scores, examined.columns, rng)
    pushed = examined.pulses.p_value(rng, DRAWS)
    return replace(found, p_value=1 - (1 - min(found.p_value, pushed)) ** 2, push_p_value=pushed)


def _extended(step: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """The step with the effect more that gains most; None where none gains enough."""
    examined, problem = step.examination, step.problem
    worth = float(np.log(len(examined.effects))) + CLASS_NATS
    found = gains(examined.scores, examined.columns)
    order = sorted(range(len(found)), key=lambda i: -found[i].log_evidence)
    rivals: list[Rival] = []
    tried: dict[str, tuple[JointEffect, Array]] = {}
    for i in order:
        effect = examined.effects[i]
        # One start of a period is enough for each joint.
        family = f"{effect.name}@{effect.part}{effect.variant}"
        if not is_free(effect) and family not in tried and found[i].log_evidence >= min(worth, 3.0):
            tried[family] = effect, first_values(examined, i, found[i].values)
        if len(tried) == REFITTED:
            break
    leader = -np.inf
    for effect, start, gain in _raced(step, list(tried.values())):
        if gain < leader - max(_BEHIND_NATS, _BEHIND * leader):
            break
        fit = refit(step, effect, start)
        rival = Rival(effect, fit.log_evidence - examined.fit.log_evidence, fit)
        report(f"refitted {effect.key}: {rival.gain:+.1f} nats{', at no size' if rival.idle else ''}")
        if not rival.idle:
            leader = max(leader, gain)
            rivals.append(rival)
    leader = max((rival.gain for rival in rivals), default=0.0)
    present = {effect.key for effect in step.hypothesis.effects}
    if step.test.push_p_value < P_VALUE:
        for push, promise in pushes(examined.pulses, problem.segments, problem.situation):
            if push.key not in present and promise > _BEHIND * leader:
                fit = refit(step, push, np.zeros(len(push.parameters)))
                rivals.append(Rival(push, fit.log_evidence - examined.fit.log_evidence, fit))
                report(f"refitted {push.name}@{push.part}: {rivals[-1].gain:+.1f} nats")
    rivals.sort(key=lambda rival: -rival.gain)
    if not rivals or rivals[0].gain < worth:
        return None
    best = _simplest(step, rivals)
    if not isinstance(best.effect, ExternalPulse) and best.gain < worth * _unrest(step, best):
        report(f"not added: {best.effect.key}, of which segments agree too little")
        return None
    examined = examine(problem, best.fit.hypothesis, best.fit.theta, best.fit.path, step.examination.noise)
    return Step(problem, examined, _test(examined, rng), best.effect, best.gain, tuple(rivals))


def _unrest(step: Step, rival: Rival) -> float:
    """By what factor scores of an effect vary more between segments than the noise says; at least 1.

    Forces that no model knows last, and are not white: of what they do, log evidence makes that much too much
    (the information over the scores' variance, as in Godambe 1960, Annals of Mathematical Statistics 31(4)).
    """
    left, fitter, fit = step.examination.left, step.problem.fitter, rival.fit
    system, prior = fitter.system(fit.hypothesis, fit.theta, fit.path)
    found = innovations(system, left.covariances(step.problem.segments.interval))
    known = np.ones(len(prior.sd), bool)
    known[fit.hypothesis.slices[-1]] = False
    return spread_over_information(scores(found, prior.at(left), known))


def _raced(
    step: Step, candidates: Sequence[tuple[JointEffect, Array]]
) -> list[tuple[JointEffect, Array, float]]:
    """Candidates fitted to some segments, best first: values to begin with, and about what all gain."""
    examined, problem = step.examination, step.problem
    S, L = problem.segments.shape
    some = np.unique(np.linspace(0, S - 1, min(S, max(4, _RACE_NODES // L))).astype(int))
    fitter = problem.fitter.select(some)
    noise = examined.left.select(some)
    system, path = examined.system.select(some), examined.fit.path[some]
    base, theta = examined.fit.hypothesis, examined.fit.theta
    none = fitter.fit(base, theta, path, noise, rounds=0, known=system).log_evidence
    raced = []
    for effect, first in candidates:
        hypothesis = base.with_effect(effect)
        starts: tuple[Array, ...] = (first, -first) if effect.both_signs else (first,)
        if len(effect.initial_values) > len(effect.parameters):
            starts = tuple(np.array(start) for start in effect.initial_values)
        fits = [
            fitter.fit(hypothesis, np.concatenate([theta, start]), path, noise, _RACE_ROUNDS, known=system)
            for start in starts
        ]
        does = [fit for fit in fits if not idle(effect, fit)]
        if does:
            fit = max(does, key=lambda fit: fit.log_evidence)
            raced.append((effect, fit.theta[len(theta) :], (fit.log_evidence - none) * S / len(some)))
    return sorted(raced, key=lambda candidate: -candidate[2])


def _simplest(step: Step, rivals: Sequence[Rival]) -> Rival:
    """The best rival, or one of fewer parameters that does the same within the error that laws have."""
    best = rivals[0]
    change = _change(step, best)
    tied = [best]
    for rival in rivals[1:]:
        if len(rival.effect.parameters) >= len(best.effect.parameters):
            continue
        told = np.ones(len(change), bool)
        if best.effect.friction and rival.effect.friction and best.effect.part == rival.effect.part:
            told = _away_from_rest(step, best.effect.part)
        left = float(np.sum((_change(step, rival) - change)[told] ** 2))
        if left < LARGEST_LAW_ERROR**2 * float(np.sum(change[told] ** 2)):
            tied.append(rival)
    return min(tied, key=lambda rival: (len(rival.effect.parameters), -rival.gain))


def _away_from_rest(step: Step, part: str) -> NDArray[np.bool_]:
    """Nodes at which a joint is so fast that laws of friction hold as well as others."""
    problem = step.problem
    joint = next(joint for joint in problem.situation.joints if joint.name == part)
    path = step.examination.fit.path[problem.segments.inside]
    speed = np.abs(path[:, problem.simulator.tangent.nq + joint.v])
    return np.asarray(speed > 2 * SLOW * joint.speed)


def _change(step: Step, rival: Rival) -> Array:
    """What a rival changes of the velocities after an interval, along the path, over the torques' effects."""
    problem, path = step.problem, step.examination.fit.path
    segments, simulator = problem.segments, problem.simulator
    n, nq = path.shape[0] * path.shape[1], simulator.tangent.nq
    x, time = path.reshape(n, -1), segments.time.reshape(n)
    order = np.repeat(segments.order, segments.shape[1])
    ends = []
    for hypothesis, theta in (
        (step.hypothesis, step.examination.fit.theta),
        (rival.fit.hypothesis, rival.fit.theta),
    ):
        model = hypothesis.compiled(theta, segments.step)
        u = hypothesis.control(segments, theta).reshape(n, segments.substeps, -1)
        ends.append(simulator.advance(hypothesis, theta, model, x, u, time, order)[0])
    inertia = np.array([1.0] * simulator.tangent.nv)
    for joint in problem.situation.joints:
        inertia[joint.v] = joint.inertia / joint.torque
    difference = (ends[1] - ends[0])[:, nq : nq + simulator.tangent.nv] * inertia
    return np.asarray(difference[segments.inside.reshape(n)])


def refit(step: Step, effect: JointEffect, start: Array, rounds: int = 8) -> Fit:
    """The step's hypothesis with one effect more, under the process force that it leaves itself.

    It begins under what is left without the effect, which holds a part of what the effect does.
    """
    examined, fitter = step.examination, step.problem.fitter
    hypothesis = examined.fit.hypothesis.with_effect(effect)
    theta = np.concatenate([examined.fit.theta, start])
    fit = fitter.fit(hypothesis, theta, examined.fit.path, examined.left, rounds, known=examined.system)
    if not np.isfinite(fit.log_evidence) or idle(effect, fit):
        return fit
    system, prior = fitter.system(hypothesis, fit.theta, fit.path)
    own = fit_process_force(system, prior, examined.left, step.problem.segments.interval)
    again = fitter.fit(hypothesis, fit.theta, fit.path, own, _AGAIN, known=system)
    return again if again.log_evidence > fit.log_evidence else fit


def first_values(examined: Examination, index: int, values: Array) -> Array:
    """First values of an effect: where its columns point, in as far as they are possible."""
    effect = examined.effects[index]
    start = np.array([parameter.start for parameter in effect.parameters])
    looks = [examined.looks[c] for c in examined.columns[index]]
    moved = start.copy()
    best = -np.inf
    for look, value in zip(looks, values, strict=True):
        which = int(np.argmax(np.abs(np.array(look.values) - start)))
        if len(looks) <= len(start):
            moved[which] = start[which] + value * look.scale
        elif abs(value) > best:  # several looks at one parameter: the one that is needed most
            best = abs(value)
            moved[which] = look.values[which]
    low = [parameter.low for parameter in effect.parameters]
    high = [parameter.high for parameter in effect.parameters]
    return np.clip(moved, low, high)


def _structured(before: Step, rival: Step, rng: np.random.Generator, report: Report) -> Step | None:
    """A model with a state of its own in place of the law that gained most; None where none is better.

    Args:
        before: without either.
        rival: with that law; `before` itself where no law gains enough.
        rng: for p-values.
        report: told what is being done.
    """
    problem, examined = before.problem, before.examination
    statistic = {j.name: 0.0 for j in problem.situation.joints}
    for effect, value in zip(examined.effects, before.test.statistics, strict=True):
        if effect.part in statistic:
            statistic[effect.part] = max(statistic[effect.part], float(value))
    parts = sorted(statistic, key=lambda part: -statistic[part])[:_STRUCTURE_JOINTS]
    # All are shot at the same segments, the rival too, under the same noise.
    own = rival.examination.fit
    law = _shot(rival.problem, own.hypothesis, own.theta, own.path, _all_white(examined.noise), _few(problem))
    tried: list[Trial] = []
    for effect in problem.catalogue:
        if not effect.hidden_state or (effect.part in statistic and effect.part not in parts):
            continue
        report(f"trying {effect.key}")
        trial = _tried(before, effect)
        if trial is not None and trial.fit.log_evidence > law.log_evidence - _SHOT_BEHIND:
            tried.append(trial)
    tried.sort(key=lambda trial: -trial.fit.log_evidence)
    if not tried:
        return None
    level = _own_evidence(rival.problem, own, rival.examination.noise)[0]
    best: tuple[float, Trial] | None = None
    for trial in tried[:2]:
        if trial.fit.log_evidence < tried[0].fit.log_evidence - _SHOT_BEHIND:
            continue
        evidence, whole = _completed(trial)
        report(f"refitted {trial.effect.key}: {evidence - level:+.1f} nats against the law that gained most")
        if best is None or evidence > best[0]:
            best = evidence, whole
    if best is None or best[0] < level + CLASS_NATS:
        return None
    evidence, whole = best
    fit = whole.fit
    examined = examine(whole.problem, fit.hypothesis, fit.theta, fit.path, whole.noise)
    gain = evidence - level + rival.gain
    rivals = (Rival(whole.effect, gain, fit), *rival.rivals)
    return Step(whole.problem, examined, _test(examined, rng), whole.effect, gain, rivals)


@dataclass(frozen=True)
class Trial:
    """A restructured problem, fitted."""

    effect: JointEffect
    problem: Problem
    fit: Fit
    noise: Noise


def structured(before: Step, effect: JointEffect) -> Examination | None:
    """The model with an effect that has a state of its own, fitted; None where there is no room for it."""
    trial = _tried(before, effect)
    if trial is None:
        return None
    _, whole = _completed(trial)
    return examine(whole.problem, whole.fit.hypothesis, whole.fit.theta, whole.fit.path, whole.noise)


def _tried(before: Step, effect: JointEffect) -> Trial | None:
    """An effect with a state of its own, fitted to some segments; None where there is no room for it."""
    problem, examined = before.problem, before.examination
    try:
        moved = problem.restructured(effect, examined.fit.path)
        present = tuple(e.on(moved.situation) for e in (*before.hypothesis.effects, effect))
    except (ValueError, KeyError):
        return None
    hypothesis = Hypothesis(moved.rig, present)
    noise = replace(_all_white(examined.noise), torque=moved.torque, initial=moved.first_noise.initial)
    theta = np.concatenate([examined.fit.theta, [p.start for p in effect.parameters]])
    return Trial(effect, moved, _shot(moved, hypothesis, theta, moved.path, noise, _few(problem)), noise)


def _completed(trial: Trial) -> tuple[float, Trial]:
    """Evidence under a noise of its own, and the fit to all segments."""
    problem, part = trial.problem.with_steps_for(trial.effect), trial.fit
    every = np.arange(problem.segments.shape[0])
    fit = _shot(problem, part.hypothesis, part.theta, problem.path, trial.noise, every, rounds=4)
    path, initial = _at_rest(problem, fit, trial.noise)
    evidence, fit, noise = _own_evidence(
        problem, replace(fit, path=path), replace(trial.noise, initial=initial)
    )
    return evidence, replace(trial, problem=problem, fit=fit, noise=noise)


def _at_rest(problem: Problem, fit: Fit, noise: Noise) -> tuple[Array, Array]:
    """A fit's motion from where nothing is deflected, and variances of first states about it.

    Those of what nobody sees are as wide as it moves then. A plate that tilts by millirad may stand anywhere
    in them, not in what a robot's joints move through: evidence loses the logarithm of that ratio in every
    segment. And about an axis that nothing loads it does not tilt.

    Returns:
        (S, L, nx) and (n,).
    """
    model, tangent, initial, first = (
        problem.rig.model, problem.simulator.tangent, noise.initial.copy(), fit.path[:, 0].copy()
    )  # fmt: skip
    # Where in a state, and where in a change of it.
    hidden = [(int(model.jnt_qposadr[model.dof_jntid[dof]]), dof) for dof in problem.rig.added_dofs]
    hidden += [(tangent.nq + dof, tangent.nv + dof) for dof in problem.rig.added_dofs]
    first[:, [at for at, _ in hidden]] = 0
    path, _ = simulate(problem.simulator, fit.hypothesis, fit.theta, problem.segments, first)
    for at, k in hidden:
        wide = _SPREAD**2 * float(np.mean(path[problem.segments.inside][:, at] ** 2))
        initial[k] = min(initial[k], max(wide, _LEAST_SPREAD * initial[k]))
    return path, initial


def _few(problem: Problem) -> NDArray[np.intp]:
    S = problem.segments.shape[0]
    return np.unique(np.linspace(0, S - 1, min(S, _SHOT_SEGMENTS)).astype(int))


def _all_white(noise: Noise) -> Noise:
    """The same, without correlation in time: so a trial is cheap."""
    white = np.sqrt(noise.white**2 + noise.coloured**2)
    return replace(noise, white=white, coloured=np.zeros_like(white))


def _shot(
    problem: Problem,
    hypothesis: Hypothesis,
    theta: Array,
    path: Array,
    noise: Noise,
    some: NDArray[np.intp],
    rounds: int = _TRIAL_ROUNDS,
) -> Fit:
    """A fit to some segments by shooting."""
    few = noise.select(some)
    simulator, segments = problem.simulator, problem.segments.select(some)
    return shoot(simulator, hypothesis, theta, segments, path[some], few, rounds)


def _own_evidence(problem: Problem, fit: Fit, noise: Noise) -> tuple[float, Fit, Noise]:
    """Evidence of a fit under the noise of its own: what it leaves is noise to it."""
    hypothesis, fitter = fit.hypothesis, problem.fitter
    system, prior = fitter.system(hypothesis, fit.theta, fit.path)
    noise = fit_noise(system, prior, noise, problem.segments, problem.kinds, near=True)
    still = fitter.fit(hypothesis, fit.theta, fit.path, noise, rounds=0, known=system)
    moved = fitter.fit(hypothesis, fit.theta, fit.path, noise, rounds=4, known=system)
    fit = moved if moved.log_evidence > still.log_evidence else still
    return fit.log_evidence, fit, noise


def _pruned(step: Step, free: Sequence[JointEffect], rng: np.random.Generator, report: Report) -> Step:
    """The step without effects that later ones have made needless."""
    kept_for_good = {effect.key for effect in free}
    while True:
        fit = step.examination.fit
        effects = fit.hypothesis.effects
        removable = [i for i, e in enumerate(effects) if e.key not in kept_for_good and not e.hidden_state]
        if len([e for e in effects if e.key not in kept_for_good]) < 2 or not removable:
            return step
        worth = float(np.log(len(step.examination.effects))) + CLASS_NATS
        best: Fit | None = None
        for i in removable:
            less = Hypothesis(fit.hypothesis.rig, tuple(e for k, e in enumerate(effects) if k != i))
            keep = np.ones(len(fit.theta), bool)
            keep[fit.hypothesis.slices[i]] = False
            # A quadratic tells what is not worth a refit.
            part = fit.hypothesis.slices[i]
            own = fit.theta[part] - fit.hypothesis.start[part]
            covariance = np.linalg.inv(fit.precision)[part, part]
            if 0.5 * own @ np.linalg.solve(covariance, own) > 4 * worth:
                continue
            without = step.problem.fitter.fit(less, fit.theta[keep], fit.path, step.examination.left)
            if without.log_evidence > fit.log_evidence - worth and (
                best is None or without.log_evidence > best.log_evidence
            ):
                best = without
        if best is None:
            return step
        report("removed an effect that is no longer needed")
        examined = examine(step.problem, best.hypothesis, best.theta, best.path, step.examination.noise)
        step = replace(step, examination=examined, test=_test(examined, rng))
