"""Physics that a rig conceals beside what the settings of blade and board say: a kind each.

`kind` says what a kind is; `swing`, `contact`, `slide`, `place`, `camera` and `across` hold those of a
phase, with the uncatalogued ones among them; `registry` finds them by name, `rehearsal` measures how much
they shift what happens, and `draw` draws what a rig conceals. All is written apart from the effects that a
diagnosis knows, and mostly as another law: a diagnosis must not win by knowing the lab.
"""
