"""Diagnosis of objects that are hit and slide: what a scene of them left out, where, and how much.

`diagnose.diagnose` takes a recording and a setting and gives a verdict: arrays and dataclasses in and
out, no files. `slide` reads tracks and their noise, and simulates what the camera should see; `launch`
simulates the launches that commands should give, and what encoders say of them; `fit` is the likelihood of
both; `selection` weighs effects of `slapshot.effects` and free forms; `held_out`, `headline` and `report` say
what follows.
"""
