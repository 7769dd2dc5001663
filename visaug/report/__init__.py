"""Pictures (one function, one figure) and one-file HTML reports of results."""
