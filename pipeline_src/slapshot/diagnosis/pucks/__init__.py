"""Diagnosis of objects that are hit and slide: what a scene of them left out, where, and how much.

`diagnose.diagnose` takes a recording and a setting and gives a verdict: arrays and dataclasses in and
out, no files. `tracks` and `noise` read the recording; `slide_model`, `marginal` and `slide_fit` fit its
slides; `strikes`, `signatures`, `execution`, `rig_model`, `launch` and `launch_fit` its launches where
commands are known; `evidence` and `search` weigh the effects of `slapshot.effects` and the free forms;
`judgement`, `held_out` and `next_hits` say what follows.
"""
