"""Is it jammed? The verdict and its grounds, and the exact hard packing."""
