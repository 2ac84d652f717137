"""Diagnosis of objects that are hit and slide: what a scene of them left out, where, and how much.

`diagnose.diagnose` takes a recording and a setting and gives a verdict: arrays and dataclasses in and
out, no files. `tracks` and `noise` read the recording; `slide_model` simulates its slides, and `strikes`,
`signatures`, `execution`, `rig_model` and `launch` the launches that commands should give; `hit_fit` is the
likelihood of both; `evidence`, `law_error` and `search` weigh effects of `slapshot.effects` and free forms;
`judgement`, `held_out` and `next_hits` say what follows.
"""
