"""Stand-in rigs with joints and hidden effects: recordings for a diagnosis of any MuJoCo model.

`rig` describes nominal rigs, `rig_simulator` and `execution` simulate them. `hidden_effect` defines the base
class of hidden effects, `hidden_effects` holds them, and `registry` finds them by name.
`effect_size_calibration` sets their sizes, `clutter` adds model errors and `noise` sensor noise,
`record_case` records a case, `case_spec` specifies it, `cases` reads lists of cases and `lists` draws them.

The lab is written independently of the diagnosis, mostly with other laws: knowing the lab must give no
advantage.
"""
