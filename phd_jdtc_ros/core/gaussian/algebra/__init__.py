"""Operations on arrays of Gaussians: products, moments, and their compiled loops."""
