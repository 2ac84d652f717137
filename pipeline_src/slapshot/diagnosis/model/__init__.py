"""The rig of joints and bodies: model, bindings, recorded segments, and hypotheses about it."""
