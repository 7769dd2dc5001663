"""Statistics of ordinary pictures without known conditions: noise of flat blocks, and recurring patterns."""
