"""Which constraints a subspace keeps."""
