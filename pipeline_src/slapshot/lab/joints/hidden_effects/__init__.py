"""Hidden effects on joints, grouped by where they act.

Most differ from the textbook law: friction is a bristle model, viscous films respond with a lag, gains fade.
Knowing the lab must give a diagnosis no advantage.
"""
