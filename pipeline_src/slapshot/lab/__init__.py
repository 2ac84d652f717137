"""The lab: a stand-in for a real rig, with concealed physics, that writes recordings like one.

`rig` says what is concealed; `path` and `blade` are its swing and contact, `ground` and `slide` what an
object does on the board, `camera` looks on. `commands` plans the session, `hit` executes it, `tables` are
what is recorded of it. `concealed` holds further physics, a kind each, for a diagnosis to name.

`joints` is a lab of its own, for arms and pendulums whose commands and joint angles are recorded.

All is written apart from the physics of the rollouts and of the effects, so that a diagnosis cannot win by
knowing it.
"""
