"""Hidden effects of a rig that hits pucks, besides those in the settings of blade and board.

`hidden_effect` defines the base class; `swing`, `contact`, `slide`, `position_time` and `camera` hold the
effects of a phase, including uncatalogued ones; `registry` finds them by name, `effect_size_calibration` sets
their sizes, and `draw` draws the effects of a rig. They are written independently of the catalogue of a
diagnosis, mostly with
other laws: knowing the lab must give no advantage.
"""
