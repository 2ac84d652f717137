"""Settings for tests that care about few of them."""

from typing import Any

from slapshot.config.acting import PolicyTraining
from slapshot.config.results import FigureSettings
from slapshot.config.trajectories import ScriptedHits

FIGURE = FigureSettings(module="any", domain="hockey")


def scripted_hits(**values: Any) -> ScriptedHits:
    """Hits of the hockey arm that it is up to."""
    usual = {
        "heading_rad": 0.5,
        "speed_m_s": [0.9, 1.7],
        "contact_offset_m": 0.04,
        "duration_s": 0.8,
        "waypoints": 17,
    }
    return ScriptedHits(**usual | values)


def policy_training(**values: Any) -> PolicyTraining:
    """A small policy."""
    usual = {
        "hidden": (16,),
        "hits": 8,
        "updates": 2,
        "step_size": 0.1,
        "tasks": 3,
        "epochs": 2,
        "learning_rate": 0.01,
    }
    return PolicyTraining(**usual | values)
