"""After the converter: effects on the developed picture, in [0, 1]."""
