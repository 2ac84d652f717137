"""Policy adaptation (S4), the earlier method that the paper compares with (its reference arndt2019meta).

A policy from a target to a latent, meta-trained on-policy in simulation so that few gradient steps on its own
hits adapt it: PPO in the outer loop, policy gradients in the inner one. No maintained library trains one:
those with PPO do not differentiate through its updates, those that do (learn2learn, higher) are no longer
maintained. With episodes of a single action, PPO reduces to its clipped objective.
"""
