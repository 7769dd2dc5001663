"""On the way to the converter: amplifiers and lines, in electrons."""
