"""`python -m fairlead COMMAND ...`."""

from fairlead.cli.main import main

main()
