"""Stand-in rigs with joints, and what they conceal: recordings for a diagnosis of any MuJoCo model.

`rig` says what everybody believes of the rigs, and `bench` makes them move. `kind` says what a kind of
concealed physics is; `kinds` holds them, and `registry` finds them by name. `rehearsal` measures how plain so
much of a kind is, `clutter` and `noise` are what else is in the way, `case` puts a case together, and `cases`
and `lists` hold lists of them.

All is written apart from what a diagnosis knows, and mostly by another law: it must not win by knowing the
lab.
"""
