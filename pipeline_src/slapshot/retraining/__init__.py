"""Closing the circle: rollouts with what a diagnosis found, models trained on them, three arms compared.

Arms: `nominal`, the scene and its ranges as they were; `refitted`, the same scene with ranges drawn closely
about what the diagnosis fitted; `augmented`, the scene with the effects that were found, and the same ranges.
`ranges`, `rollouts` and `held_out` make what the stages of adaptation read, `__main__` compares.
"""

ARMS = ("nominal", "refitted", "augmented")
