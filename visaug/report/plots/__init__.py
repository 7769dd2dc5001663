"""Pictures: one function, one figure; every axis has its unit."""
