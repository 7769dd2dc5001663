"""`python -m visaug` is the program."""

from visaug.app.cli import main

if __name__ == "__main__":
    main()
