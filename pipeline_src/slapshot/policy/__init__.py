"""Policy adaptation (S4), the earlier method that the paper compares with (its reference arndt2019meta).

A policy from a target to a latent, meta-trained on-policy in simulation so that few gradient steps on its own
hits adapt it: PPO outside, policy gradients inside. No kept library trains one: those with PPO do not
differentiate through its updates, those that do (learn2learn, higher) are no longer kept; and with
episodes of a single action, nothing is left of PPO but its clipped objective.
"""
