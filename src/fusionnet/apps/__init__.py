"""What a person starts: the command line. Only this folder prints."""
