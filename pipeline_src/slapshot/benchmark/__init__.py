"""Computing cost and accuracy of the pipeline, as ratios measured in one run."""
