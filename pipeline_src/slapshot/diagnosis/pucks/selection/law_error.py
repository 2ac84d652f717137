"""What the nominal laws are known to: errors of theirs that belong to the null hypothesis.

A simulated swing is right to about one time step, as is the moment of a simulated launch; its velocity is to
about a hundredth, smoothly over where and at which angle the object is met and over how fast and whither it
leaves; and dry friction is the same at all speeds to about a hundredth. Columns of such errors stand
beside those of friction as nuisance, with priors of that size. Of the law of friction only that counts as
error which no catalogued law of the slide describes: those stay testable.
"""

from collections.abc import Sequence

import numpy as np

from slapshot.arrays import GRAVITY
from slapshot.diagnosis.inference.mismatch_test import Scores
from slapshot.diagnosis.pucks.launch.strikes import TIMESTEP
from slapshot.diagnosis.pucks.slide.slide_model import Column

# Whose columns are those of a swing and of a launch one step late.
STEPS = (("command_delay", "delay"), ("camera_time", "delay"))
SPEED_FORM = "free_speed"  # whose bumps along the motion are those of friction by speed
FRICTION_KNOWN_TO = 0.01
# Whose changes of a launch's velocity are those of errors of swing and contact.
LAUNCH_FORMS = "free_contact", "free_launch"
CONTACT_KNOWN_TO = 0.01  # of the speed


def with_law_errors(
    of: Scores, columns: Sequence[Column], sliding: Sequence[str], log_mu: float, speed: float
) -> Scores:
    """Scores with columns of law errors, in units of their priors, after those that are there.

    Args:
        of: scores in units of the priors; `columns` are theirs.
        columns: of nuisance and hypotheses.
        sliding: catalogued effects of the slide, to which errors of friction are made orthogonal.
        log_mu: logarithm of the friction coefficient.
        speed: mean of launches, in m/s.
    """
    late = [c for c, column in enumerate(columns) if (column.owner, column.parameter) in STEPS]
    bent = [
        c
        for c, column in enumerate(columns)
        if column.owner == SPEED_FORM and column.parameter.startswith("along")
    ]
    struck = [
        c
        for c, column in enumerate(columns)
        if column.owner in LAUNCH_FORMS and column.parameter.startswith(("faster", "sideways"))
    ]
    known = [c for c, column in enumerate(columns) if column.owner in sliding or of.nuisance[c]]
    size = len(columns)
    added = np.zeros((size, len(late) + len(bent) + len(struck)))
    for k, c in enumerate(late):
        added[c, k] = TIMESTEP / of.prior_sd[c]
    if bent:
        errors = len(late) + np.arange(len(bent))
        total = of.H.sum(0)
        inner = total[known][:, known] + 1e-6 * np.eye(len(known))
        share = np.linalg.solve(inner, total[known][:, bent])
        scale = FRICTION_KNOWN_TO * GRAVITY * np.exp(log_mu) / of.prior_sd[bent]
        added[bent, errors] = scale
        added[np.array(known)[:, None], errors] = -share * scale
    for k, c in enumerate(struck, len(late) + len(bent)):
        added[c, k] = CONTACT_KNOWN_TO * speed / of.prior_sd[c]
    crossed = of.H @ added
    return Scores(
        np.concatenate([of.b, of.b @ added], axis=1),
        np.block([[of.H, crossed], [crossed.transpose(0, 2, 1), added.T @ crossed]]),
        np.concatenate([of.prior_sd, np.ones(added.shape[1])]),
        np.concatenate([of.nuisance, np.ones(added.shape[1], bool)]),
    )
