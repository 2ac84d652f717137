"""Closing the loop: rollouts with the effects that a diagnosis found, models trained on them, in three arms.

Arms: `nominal`, the unchanged scene and ranges; `refitted`, the same scene with narrow ranges about the
parameters that the diagnosis fitted; `augmented`, the scene with the effects that were found, and the ranges
of `refitted`. `ranges`, `rollouts` and `held_out` prepare the inputs of the stages of adaptation, `__main__`
compares the arms.
"""

ARMS = ("nominal", "refitted", "augmented")
