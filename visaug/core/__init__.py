"""What every room builds on: random streams, errors, whole files, strict documents, progress."""
