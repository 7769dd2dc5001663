"""Constants of nature and of statistics."""

ZERO_C_K = 273.15  # K, 0 degrees Celsius
BOLTZMANN_EV_PER_K = 8.617333e-5  # CODATA 2018
MAD = 1.4826  # standard deviation of a normal distribution over the median of its sizes
