"""The SPEED/SPEED+ pose harness over visaug; installed as `visaug_train`."""
