"""`python -m benchmark`, from the root of the checkout."""

from benchmark.commands import main

main()
