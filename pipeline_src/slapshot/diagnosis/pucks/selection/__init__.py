"""Which effects are there: screen, refit, add, delete; and what is left without a name."""
