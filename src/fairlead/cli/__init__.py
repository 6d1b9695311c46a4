"""The command line: one short file a command. Each parses a typed config and calls one library function."""
