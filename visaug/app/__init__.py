"""What a person starts: the program and the page."""
