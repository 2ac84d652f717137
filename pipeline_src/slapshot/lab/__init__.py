"""The lab: a simulated stand-in for a real rig, with hidden physics, that writes recordings.

`rig` holds the true parameters; `executed_trajectory` and `blade` model the swing and the contact, `surface`
and `slide` the motion of the object on the board, `camera` the observations. `commands` plans the session,
`hit` executes it, and `tables` writes its recording. `concealed` holds further hidden effects, one module
each, which a diagnosis has to identify.

`joints` is a separate lab for arms and pendulums, whose recordings hold commands and joint angles.

The lab shares no physics code with the rollouts or with the effects of the diagnosis, so that a diagnosis
cannot succeed merely by using the same model.
"""
