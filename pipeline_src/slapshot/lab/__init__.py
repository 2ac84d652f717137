"""The lab: a stand-in for a real rig, with concealed physics, that writes recordings like one.

`rig` says what is concealed, `blade`, `board` and `slide` are its physics, `hit` executes a command,
`camera` looks on, `commands` plans the session. The physics is written apart from that of the rollouts
and of the effects, so that a diagnosis cannot win by knowing it.
"""
