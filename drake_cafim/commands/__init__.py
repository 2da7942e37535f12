"""What each command of `cafim` does, one file a command; `cli` only reads the arguments."""
