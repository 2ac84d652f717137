"""What a model of joints and bodies may leave out: one file an effect."""
