"""Pictures of an unknown camera: its noise, a camera estimated from them, two sets compared."""
