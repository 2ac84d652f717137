"""The configuration: config/default.yaml, files laid over it, and the models that say what may stand in them.

What a key means and which values it takes stands in one model a block, and beside it what the stages are told
that are made from that block: `scene`, `randomisation`, `trajectories`, `rollouts`, `methods`, `acting`,
`lab`, `recordings`, `sources`, `refinement`, `retraining`, `regression`, `cases`, `calibration`, `results`.
`domain` and `configuration` put the blocks together, `values` has what they share, `files` reads them.

Nothing is imported here: a stage depends on the blocks that it imports, and on no others.
"""
