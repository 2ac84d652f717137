"""What the pipeline costs and how exact it is, as ratios measured in one run."""
