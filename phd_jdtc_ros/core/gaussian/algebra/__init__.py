"""Operations on Gaussians: blocks of one, and arrays of many."""
