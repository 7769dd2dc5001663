"""Effects that may be missing: trials of each, their signatures, the best matches, and these refined by maximum likelihood."""
