"""The configuration: config/default.yaml, files that override it, and the models that validate them.

Each block has one model, which defines its keys and their allowed values, and next to it the settings of the
stages that use the block: `scene`, `randomisation`, `trajectories`, `rollouts`, `methods`, `acting`, `lab`,
`recordings`, `sources`, `refinement`, `retraining`, `regression`, `cases`, `calibration`, `results`.
`domain` and `configuration` combine the blocks, `values` has the types that they share, `files` reads them.

Nothing is imported here, so that a stage depends only on the blocks that it imports.
"""
