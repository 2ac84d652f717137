"""slapshot: few-shot adaptation of dynamics models, and named causes where simulators and robots disagree."""
