"""Studies on top of the protocol: hidden effects, cameras estimated from pictures, and the demonstrations."""
