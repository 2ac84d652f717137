"""What the paper claims, held against our own numbers: a file a claim, each verdict computed."""
