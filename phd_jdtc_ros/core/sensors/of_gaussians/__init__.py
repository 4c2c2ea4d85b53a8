"""The measurements that sensors make of Gaussians: array operations, and compiled ones."""
