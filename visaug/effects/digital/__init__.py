"""In and after the converter: DN."""
