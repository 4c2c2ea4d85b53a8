"""The fixed-lag smoother of Gaussians: the updates of each target, and the backward step."""
