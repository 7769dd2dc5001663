"""On the way to the sensor: effects on the mean photons per pixel."""
