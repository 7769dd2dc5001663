"""Statistics of ordinary pictures, of which nothing is known but the pixels: noise of flat blocks, and what recurs."""
